"""What is said about ranks before a run."""

from headstock.app.actions.running import _describe_crowd


def test_more_ranks_than_free_cores_take_turns() -> None:
    assert "4 ranks on 2 free cores take turns" in _describe_crowd(4, 1, 2)


def test_threads_of_all_ranks_beyond_the_free_cores_are_named_with_the_number_that_fits() -> None:
    said = _describe_crowd(2, 2, 2)
    assert "2 ranks with 2 threads each" in said
    assert said.endswith("HEADSTOCK_THREADS=1")
