"""The search of the site leads from questions to the pages that answer them."""

import json
import shutil
import tomllib
from pathlib import Path

import pytest
from site_search import SiteSearch, read_built, read_markdown

from common import run_process

ROOT = Path(__file__).resolve().parent.parent
ASKED = tomllib.loads((ROOT / "tests" / "data" / "questions.toml").read_text())
HITS = 3  # that somebody looks at
# the site's own program, as a browser runs it beside a page
WORKER = """
const fs = require("fs"), site = process.argv[1], queries = JSON.parse(process.argv[2]);
const folder = site + "/assets/javascripts/workers/";
let answer, listener;
globalThis.self = globalThis;
globalThis.addEventListener = (_, given) => { listener = given };
globalThis.window = { Worker: class {
  addEventListener(kind, heard) { globalThis.postMessage = data => { heard({ data }); answer(data) } }
  postMessage(message) { listener({ data: message }) }
} };
(0, eval)(fs.readFileSync(site + "/javascripts/search_words.js", "utf8"));
const worker = new window.Worker();
const ask = message => new Promise(done => { answer = done; worker.postMessage(message) });
(0, eval)(fs.readFileSync(folder + fs.readdirSync(folder).find(name => name.endsWith(".js")), "utf8"));
(async () => {
  await ask({ type: 0, data: { ...JSON.parse(fs.readFileSync(site + "/search/search_index.json")), options: {} } });
  const pages = {};
  for (const query of queries) {
    const { data } = await ask({ type: 2, data: query });
    pages[query] = data.items.map(hits => hits[0].location.split("#")[0].replace(".html", ""));
  }
  console.log(JSON.stringify(pages));
})();
"""


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


def test_questions_find_their_pages(search: SiteSearch) -> None:
    assert len(ASKED["questions"]) >= 30
    lacking = missed(search)
    assert len(lacking) <= 2, lacking


@pytest.mark.parametrize(
    ("sentence", "pages"),
    [
        ("How do I read a UFF file of a modal test?", ["faq", "test_data"]),
        ("what is the damping of a linear guide", ["frequency_response", "faq"]),
        ("where do I write interface_errors", ["errors", "scene_reference"]),
        ("where do I find the compliance at the tool of my machine", ["faq"]),
    ],
)
def test_a_whole_sentence_finds_a_few_pages_by_the_words_that_say_something(
    search: SiteSearch, sentence: str, pages: list[str]
) -> None:
    found = search.find_pages(sentence)
    assert len(found) <= 10 and not set(pages).isdisjoint(found[:HITS])
    assert search.find_pages("how do I the a of") == []


def test_a_search_for_what_is_not_in_it_says_so(search: SiteSearch) -> None:
    hits = {word: search.find_pages(word)[:HITS] for word in ASKED["absent"]}
    assert len(hits) > 30
    assert {word: pages for word, pages in hits.items() if "limits" not in pages} == {}


@pytest.mark.trials
@pytest.mark.process
@pytest.mark.skipif(shutil.which("node") is None, reason="node runs the site's own program")
def test_a_built_site_finds_what_is_found_here(tmp_path: Path) -> None:
    command = [str(ROOT / "headstock"), "docs", "--quick", "-o", str(tmp_path / "site")]
    run_process(command, timeout=300, check=True)
    built = SiteSearch(read_built(tmp_path / "site"))
    assert len(missed(built)) <= 2
    queries = [*(ask["query"] for ask in ASKED["questions"]), *ASKED["absent"]]
    done = run_process(
        ["node", "-e", WORKER, str(tmp_path / "site"), json.dumps(queries)], check=True
    )
    shown = json.loads(done.stdout)
    assert {query: built.find_pages(query)[:HITS] for query in queries} == {
        query: pages[:HITS] for query, pages in shown.items()
    }
