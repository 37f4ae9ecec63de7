"""What a validation found, in words."""

import math
from collections.abc import Mapping

from stereocal.calibration.methods import METHOD_NAMES, METHODS, Method
from stereocal.evaluation.summary import MethodSummary, best_methods
from stereocal.system.numbers import digits
from stereocal.verdict.in_words import percent


def validation_answer(summaries: Mapping[Method, MethodSummary]) -> str:
    """What the sets did on held-out frames. What to use is said by the recommendation alone.

    Of the paper's sets: the 2D set for pairs and the 3D set for lengths if they are best, or if
    their intervals overlap that of the best. The refined set has a separate sentence.
    """
    paper = {method: summaries[method] for method in METHODS if method in summaries}
    match, measure = (
        _made_for(paper, "reprojection", "2d"),
        _made_for(paper, "reconstruction", "3d"),
    )
    pairs, lengths = _pairs_in_words(paper[match]), _lengths_in_words(paper[measure])
    answer = f"Held out here: with {_name(match)}{pairs}; with {_name(measure)}, {lengths}."
    if (refined := summaries.get("refined")) is not None:
        both = f"{_pairs_in_words(refined)}, and {_lengths_in_words(refined)}"
        answer += f" With the one refined set{both}."
    return answer


def _pairs_in_words(summary: MethodSummary) -> str:
    matching = summary.reprojection
    return (
        f" below {digits(matching.threshold, 2)} px, {percent(matching.wrong_let_in)} % of wrong "
        f"pairs are accepted and {percent(matching.correct_lost)} % of correct ones are lost"
    )


def _lengths_in_words(summary: MethodSummary) -> str:
    within = summary.reconstruction.p95
    if not math.isfinite(within):
        return "no bar could be measured"
    return f"95 % of bars are within {percent(within)} %"


def _made_for(paper: Mapping[Method, MethodSummary], quantity: str, intended: Method) -> Method:
    best = best_methods(paper)[quantity]
    if intended not in paper:
        return best
    figure, least = paper[intended].main(quantity), paper[best].main(quantity)
    # Of too few runs for intervals, no set is said to be better: that comparison is false of NaN.
    return best if figure.low > least.high or math.isnan(figure.value) else intended


def _name(method: Method) -> str:
    return "the essential matrix" if method == "essential" else f"the {METHOD_NAMES[method]}"
