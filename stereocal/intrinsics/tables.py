"""A lens calibration as sentences and table rows, for the screen and the terminal."""

from __future__ import annotations

import math

import pandas as pd

from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.quality import coverage

LENS_COLUMNS = ("parameter", "value", "standard error", "spread of draws", "all at once")


def lens_answer(lens: LensCalibration) -> str:
    """A sentence with the focal length and its quality."""
    fx, sigma = lens.values[0], lens.standard_errors[0]
    views = len(lens.search.views)
    turned = sum(view.turned for view in lens.search.views)
    boards = "1 board" if turned == 1 else f"{turned} boards"
    order = f" The corner order of {boards} was corrected." if turned else ""
    return (
        f"The focal length fx is {with_error(fx, sigma)} px; corners fit to {lens.error_px:.3f} px "
        f"(root mean square). {len(lens.drawn)} draws of {lens.per_draw} out of {views} "
        f"photographs; the corners cover {100 * coverage(lens.search):.0f} % of the image.{order}"
    )


def lens_rows(lens: LensCalibration) -> list[tuple[str, str, str, str, str]]:
    """A row of `LENS_COLUMNS` for each parameter; digits by the standard error."""
    rows = []
    for at, name in enumerate(filter(None, lens.settings.parameters)):
        value, sigma = float(lens.values[at]), float(lens.standard_errors[at])
        if lens.settings.free[at] == 0:
            rows.append((name, "0", "held at 0", "", "0"))
            continue
        digits = _digits(sigma)
        rows.append(
            (
                f"{name} (px)" if at < 4 else name,
                f"{value:.{digits}f}",
                f"{sigma:.{digits}f}",
                f"{float(lens.spread[at]):.{digits}f}",
                f"{float(lens.of_all[at]):.{digits}f}",
            )
        )
    return rows


def lens_table(lens: LensCalibration) -> pd.DataFrame:
    """The rows for the screen."""
    titles = [title.capitalize() for title in LENS_COLUMNS]
    return pd.DataFrame(lens_rows(lens), columns=titles).set_index("Parameter")


def with_error(value: float, sigma: float) -> str:
    """`7124.3 ± 1.4`: the error with two significant digits, the value with as many decimals."""
    digits = _digits(sigma)
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def _digits(sigma: float) -> int:
    """Decimals that show two digits of an error."""
    if not sigma > 0:
        return 3
    return min(max(1 - math.floor(math.log10(sigma)), 0), 9)
