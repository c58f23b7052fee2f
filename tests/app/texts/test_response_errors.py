"""Errors of frequency responses by source: in tables, in files and in words."""

import csv
import io

import numpy as np
import pytest

from common import approx
from headstock.app.tables.frf import tabulate_response
from headstock.app.tables.table import encode_csv
from headstock.app.texts.bounded_values import response_error_words
from headstock.pipeline.answers.frf import PoseResponse, ResponseCurves
from headstock.pipeline.numbers.estimates import DISCRETISATION, REDUCTION

CHANNEL = ("tcp", "x")
HZ = np.array([0.0, 10.0, 20.0])
RESPONSE = np.array([2.0, -4.0 + 3.0j, 1.0])[:, None, None]
MESH, MODES = np.array([0.2, 1.0, 0.1])[:, None, None], np.array([0.0, 0.5, np.nan])[:, None, None]


@pytest.fixture
def curves() -> ResponseCurves:
    shares = {DISCRETISATION: MESH, REDUCTION: MODES}
    return ResponseCurves(
        "reference", (CHANNEL,), (CHANNEL,), HZ, RESPONSE, motion="mobility", error_share=shares
    )


def test_the_error_of_a_line_is_the_sum_of_its_parts_and_each_has_a_column(
    curves: ResponseCurves,
) -> None:
    np.testing.assert_array_equal(curves.error, MESH + MODES)
    heading, *rows = list(csv.reader(io.StringIO(encode_csv(tabulate_response(curves)).decode())))
    assert [name.split(" tcp")[0] for name in heading[3:]] == [
        "±",
        "± discretisation",
        "± reduction",
    ]
    assert [float(cell) for cell in rows[1][3:]] == approx(
        [20.0 * np.pi * size for size in (1.5, 1.0, 0.5)]
    )
    assert rows[2][3] == rows[2][5] == "" and float(rows[2][4]) > 0.0


def test_words_name_every_source_and_what_is_left_out(curves: ResponseCurves) -> None:
    response = PoseResponse(curves, "modal", True, (), (), (), ("rigid model of base",))
    words = response_error_words(response)
    assert words[0].startswith(
        "± covers 95 % of errors, from discretisation 15 % of a line in the median, at most 20 % at 10 Hz; reduction 5 %"
    )
    assert words[1:] == ["no bound above 10 Hz", "not in ±: rigid model of base"]
