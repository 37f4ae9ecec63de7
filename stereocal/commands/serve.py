"""`stereocal serve`: the dashboard in a browser."""

import argparse
import importlib
import os
import subprocess
import sys

from stereocal.commands.console import Number, Options
from stereocal.errors import StereocalError
from stereocal.system.resources import ROOT

OPTIONS: Options = {
    "--port N": {"type": Number(int, 1, 65535), "help": "default: 8501, or the next free one"},
    "--headless": "do not open a browser; print the address",
}


def run(parsed: argparse.Namespace) -> None:
    """Run the server until it is stopped; the same as `streamlit run app.py` in a checkout."""
    importlib.import_module("streamlit")  # `cli` says how to install it
    options = ["--server.port", str(parsed.port)] if parsed.port is not None else []
    options += ["--server.headless", "true"] if parsed.headless else []
    command = [sys.executable, "-m", "streamlit", "run", str(ROOT / "app.py"), *options]
    if os.name != "nt":
        os.execv(sys.executable, command)  # signals then reach the server itself
    status = subprocess.run(command, check=False).returncode
    if status:
        raise StereocalError("The dashboard has stopped. Its last lines say why.")
