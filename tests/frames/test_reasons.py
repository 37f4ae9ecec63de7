"""What several frames share in why they are doubtful is said once."""

from stereocal.frames.reasons import LISTED, shared_reasons, without_names


def blurred(width: int) -> str:
    return f"The target at ({10 * width}, 50) is blurred: its edges are {width} px wide."


def test_what_several_share_is_said_once_with_their_numbers() -> None:
    reasons = {
        3: f"In the primary: {blurred(5)} {blurred(6)} The two targets look different.",
        4: "",
        7: f"Primary: No ball B was found. In the secondary: {blurred(7)}",
        9: "A and B fit the other frames only if they are exchanged in one camera.",
        11: "Primary: No ball B was found.",
        12: blurred(3),
    }
    shared, rest = shared_reasons(reasons)
    assert shared == [
        "3 frames: a target is blurred. Frames 3, 7, 12.",
        "2 frames: no ball B was found. Frames 7, 11.",
    ]
    assert {frame: own for frame, own in rest.items() if own} == {
        3: "The two targets look different.",
        9: reasons[9],
    }


def test_of_many_frames_the_first_are_listed() -> None:
    ((sentence,), rest) = shared_reasons({k: blurred(k) for k in range(100, 150)})
    assert sentence.startswith("50 frames: ") and "and 38 more" in sentence
    listed = sentence.partition("Frames ")[2].split(" and ")[0].split(", ")
    assert listed == [str(k) for k in range(100, 100 + LISTED)]
    assert not any(rest.values())


def test_boards_share_what_is_said_of_photographs_with_other_names() -> None:
    none, far = "no board is visible", "the board is too far away: its corners are 3 px apart"
    whys = {k: f"left{k}.png: {none}; right{k}.png: {far}" for k in (1, 11)} | {4: f"a.png: {none}"}
    names = {k: (f"left{k}.png", f"right{k}.png") for k in (1, 11)} | {4: ("b.png", "a.png")}
    shared, rest = shared_reasons({k: without_names(why, names[k]) for k, why in whys.items()})
    assert shared == [
        "3 frames: no board is visible. Frames 1, 4, 11.",
        "2 frames: the board is too far away. Frames 1, 11.",
    ]
    assert not any(rest.values())
