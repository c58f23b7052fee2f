"""The search of the site leads from questions to the pages that answer them."""

import shutil
import tomllib
from pathlib import Path

import pytest

from site_search import SiteSearch, read_markdown

ROOT = Path(__file__).resolve().parent.parent
ASKED = tomllib.loads((ROOT / "tests" / "data" / "questions.toml").read_text())
HITS = 3  # that somebody looks at


@pytest.fixture(scope="module")
def search() -> SiteSearch:
    return SiteSearch(read_markdown(ROOT))


def missed(search: SiteSearch) -> dict[str, list[str]]:
    """Questions whose answer is not among the first hits, with these."""
    hits = {ask["query"]: search.find_pages(ask["query"])[:HITS] for ask in ASKED["questions"]}
    return {
        ask["query"]: hits[ask["query"]]
        for ask in ASKED["questions"]
        if set(ask["pages"]).isdisjoint(hits[ask["query"]])
    }


def test_thirty_questions_find_their_pages(search: SiteSearch) -> None:
    assert len(ASKED["questions"]) == 30
    lacking = missed(search)
    assert len(lacking) <= 2, lacking


def test_a_search_for_what_is_not_in_it_says_so(search: SiteSearch) -> None:
    hits = {word: search.find_pages(word)[:HITS] for word in ASKED["absent"]}
    assert len(hits) > 30
    assert {word: pages for word, pages in hits.items() if "limits" not in pages} == {}
