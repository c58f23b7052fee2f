"""How large ± of computed responses is, in a sentence."""

import dataclasses

import numpy as np

from headstock.app.tables.correlation import describe_response_errors
from headstock.pipeline.answers.frf import ResponseCurves
from headstock.studies.correlation.responses import ComparedResponses


def test_errors_of_responses_are_shares_of_each_line_and_what_they_lack_is_named() -> None:
    """Entries that are not drawn have none."""
    channels = (("1", "x"), ("2", "x"))
    values = np.full((101, 2, 1), 2.0 + 0.0j)
    errors = np.full((101, 2, 1), np.nan)
    errors[:, 0, 0] = np.linspace(0.0, 0.2, 101)
    computed = ResponseCurves(
        "p", channels[:1], channels, np.ones(101), values, error_share={"mesh": errors}
    )
    compared = ComparedResponses(
        *(computed, computed, np.ones((2, 1)), np.ones((1, 1)), np.ones(1)),
        shown=((channels[0], channels[0]),),
        damping="none",
        left_out=("rigid model of base",),
    )
    text = describe_response_errors(compared)
    assert text.endswith("5 % on half of the lines, 9.5 % on 95 %; without rigid model of base")
    bare = dataclasses.replace(computed, error_share={})
    text = describe_response_errors(dataclasses.replace(compared, computed=bare))
    assert text == "± of computed responses is not known (rigid model of base)"
