"""Records of analyses name what does their work and what it finds."""

import pytest

from headstock.pipeline.answers.answer import Answer
from headstock.pipeline.planning.analyses import (
    RECORDS,
    AnalysisRecord,
    load_answer_types,
    load_named,
)


@pytest.mark.parametrize("record", RECORDS, ids=lambda record: str(record.kind))
def test_a_record_names_a_function_and_an_answer(record: AnalysisRecord) -> None:
    assert callable(load_named(record.solve))
    answer = load_named(record.answer)
    assert issubclass(answer, Answer) and answer.entry


def test_every_answer_has_an_entry_of_its_own() -> None:
    entries = [kind.entry for kind in load_answer_types()]
    assert len(set(entries)) == len(entries) > len(RECORDS)
