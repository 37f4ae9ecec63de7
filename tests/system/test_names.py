"""What a name may be, and how one is written that a spreadsheet would run."""

import io

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereocal.system.csv_text import as_names, csv_text, quoted, unquoted
from stereocal.system.names import LONGEST, check_name, check_path, label_of, named_after
from stereocal.system.zip_files import open_zip, pack_zip
from tests.refused import refused


def test_a_label_is_mended_and_cut_and_keeps_its_ending() -> None:
    assert label_of("Swifts, day 2.csv") == "Swifts, day 2.csv"
    cut = label_of(20_000 * "é" + ".json")
    assert len(cut) == LONGEST and cut.endswith("é.json") and label_of(cut) == cut
    assert label_of("a\ud800\n\0b\u2028") == "a   b "
    assert label_of("A\u00a0\u200d") == "A\u00a0\u200d"  # blanks and joints of letters


def test_a_name_is_kept_or_refused() -> None:
    for good in ("1", "1.0", "-1", "+x", "=cmd", "Schwalbe \u00e4", "a\u00a0b", LONGEST * "x"):
        assert check_name("A track", good) == good
    for bad in ("", " ", "a ", "\ta", "\ra", "a\nb", "\0", "\udc00", (LONGEST + 1) * "x"):
        with refused("A track"):
            check_name("A track", bad)


def test_a_path_that_no_disk_has_is_refused_in_a_zip() -> None:
    long = 1001 * "x" + ".jpg"
    assert check_path(long[5:], "x.zip") == long[5:]
    with refused("1,005"), open_zip(pack_zip({long: b"x"}), "x.zip"):
        raise AssertionError


SIGNS = st.text("=+-@'\t\r\n\uff1d.,1eax |", max_size=6)
NAMES = st.text("=+-@'\uff1d.,1eax |\"", min_size=1, max_size=6).map(str.strip)


@given(SIGNS)
def test_what_is_quoted_is_read_back_and_runs_nowhere(text: str) -> None:
    written = quoted(text)
    assert unquoted(written) == text
    if written[:1] in ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d"):
        assert not written.strip("=+-@") or float(written.replace(",", ".")) is not None


@given(st.lists(st.tuples(NAMES, st.integers(-5, 5)), min_size=1, max_size=5), NAMES)
def test_names_of_a_table_are_read_as_they_were(rows: list[tuple[str, int]], head: str) -> None:
    text = csv_text(pd.DataFrame(rows, columns=[f"{head}x", "n"]))
    read = pd.read_csv(io.StringIO(text), dtype=str, keep_default_na=False)
    assert [unquoted(str(name)) for name in read] == [f"{head}x", "n"]
    assert as_names(read.iloc[:, 0]).tolist() == [name for name, _ in rows]
    assert read["n"].tolist() == [str(number) for _, number in rows]


def test_numbers_and_lone_signs_are_no_formulas() -> None:
    for text in ("-1", "+1.5e-3", "-0,5", "-", "--", "=", "-inf", "left-1", "'a", "a=b"):
        assert quoted(text) == text
    for text in ("=1", "-a", "+x", "@x", "-1+cmd|x", "'=x", "\uff1dx"):
        assert quoted(text) == f"'{text}"


@pytest.mark.parametrize(
    ("files", "cameras"),
    [
        (["points_1.csv", "Cam-1.csv", "3 Cam-12.csv"], ["1", "cam-1", "cam-12"]),
        (["trial_2_cam_1.csv", "trial_2_cam_3.csv"], ["1", "3"]),
        (["cam2.csv", "camera1.csv"], ["2", "1"]),
        (["cam-1DLC_resnet50.csv", "cam-2DLC_resnet50.csv"], ["cam-1", "cam-2"]),
        (["left_right_cam_left.csv", "left_right_cam_right.csv"], ["left", "right"]),
    ],
)
def test_files_are_of_the_cameras_in_their_names(files: list[str], cameras: list[str]) -> None:
    wanted = dict(zip(files, cameras, strict=True))
    for order in ([*cameras, "2x"], ["2x", *reversed(cameras)]):
        assert named_after(files, order) == wanted


@pytest.mark.parametrize(
    ("files", "said"),
    [
        (["points_11.csv", "2.csv"], "points_11"),
        (["a1.csv", "2.csv"], "a1"),
        (["1.csv", "p_1.csv"], "p_1"),
        (["1_2.csv", "2.csv"], "1_2"),
    ],
)
def test_a_file_whose_camera_is_not_told_is_named(files: list[str], said: str) -> None:
    with refused(said):
        named_after(files, ["1", "2"])
