"""The dashboard: `streamlit run app.py`. Page settings and the list of pages, nothing else."""

from pathlib import Path

import streamlit as st

from stereocal.ui.project import keep_address, warm_up

PAGES = (
    ("pages/start.py", "Start", "start"),
    ("pages/data.py", "Data", "data"),
    ("pages/calibrate.py", "Calibrate", "calibrate"),
)


def main() -> None:
    """Draw the frame and run the chosen page."""
    icon = Path(__file__).parent / "assets" / "icon.png"
    st.set_page_config(page_title="stereocal", page_icon=str(icon), layout="wide")
    warm_up()
    page = st.navigation(
        [
            st.Page(path, title=title, url_path=url, default=url == "start")
            for path, title, url in PAGES
        ]
    )
    keep_address()
    page.run()


if __name__ == "__main__":
    main()
