"""What is written of a dataclass."""

from stereocal.calibration.methods import CalibrationSettings
from stereocal.system.records import of_plain, plain


def test_settings_that_were_not_stated_are_written_with_their_defaults() -> None:
    """msgspec alone leaves them out: files then did not state `maximum_moves`."""
    read = of_plain({"search": {"seed": 3}}, CalibrationSettings)
    assert plain(read)["search"]["maximum_moves"] == CalibrationSettings().search.maximum_moves
    assert plain(read).keys() == plain(CalibrationSettings()).keys()
