"""The search of the documentation's site, without a browser.

Sections of the Markdown are ranked as the site ranks those of its pages: BM25 of lunr over titles and
texts with the boosts of MkDocs Material, every word of a query standing for all that begin with it, but
for those that ``docs/javascripts/search_words.js`` leaves out. On
a built site ``tests/test_site_search.py`` compares it with the site's own program, where node is there.
"""

import json
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

SETTINGS_FILE = Path(__file__).resolve().parent.parent / "mkdocs.yml"
SETTINGS = SETTINGS_FILE.read_text()
SEPARATOR = re.compile(re.findall(r"^      separator: '(.*)' #", SETTINGS, re.M)[0])
TAG = re.compile(r"<[^>]*>")
FIELD_BOOSTS = {"title": 1e3, "text": 1.0}
K1 = 1.2
SCRIPT = SETTINGS_FILE.parent / "docs" / "javascripts" / "search_words.js"
STOP_WORDS, ASKING = (
    frozenset(re.findall(rf"{name} = `(.*?)`", SCRIPT.read_text(), re.S)[0].split())
    for name in ("STOPPED", "ASKING")
)
MOST_PAGES = int(re.findall(r"MOST_PAGES = (\d+);", SCRIPT.read_text())[0])
HEADING = re.compile(r"^#{1,6} +(.*?)(?: *\{[^}]*\})?$")
LINK = re.compile(r"!?\[([^\]]*)\]\([^)]*\)(?:\{[^}]*\})?")


class Section(NamedTuple):
    """A heading and what stands below it, in the page of this name.

    Attributes:
        boost: Of its page, by the kind of page.
        first: Whether the page begins with it.
    """

    page: str
    title: str
    text: str
    boost: float
    first: bool


def read_markdown(project: Path) -> list[Section]:
    """Return the sections of all pages in the menu of the site, but for those made by mkdocstrings."""
    boosts: dict[str, str] = dict(re.findall(r"^    ([\w-]+): ([\d.]+)$", SETTINGS, re.M))
    sections, kind = list[Section](), ""
    for line in SETTINGS.partition("\nnav:\n")[2].splitlines():
        if top := re.match(r"  - ([\w-]+):", line):
            kind = top[1]
        if named := re.search(r"- (?:.+: )?(\S+)\.md$", line):
            page = project / "docs" / f"{named[1]}.md"
            text = page.read_text() if page.exists() else _read_notebook(page.with_suffix(".ipynb"))
            sections += _split_page(
                named[1], text, float(boosts.get(named[1]) or boosts.get(kind, "1"))
            )
    return sections


def read_built(site: Path) -> list[Section]:
    """Return the sections that a built site searches."""
    sections, seen = list[Section](), set[str]()
    for entry in json.loads((site / "search" / "search_index.json").read_text())["docs"]:
        page = entry["location"].partition("#")[0].removesuffix(".html")
        sections.append(
            Section(page, entry["title"], entry["text"], entry.get("boost", 1), page not in seen)
        )
        seen.add(page)
    return sections


class SiteSearch:
    """An index of sections.

    Attributes:
        weights: Of each token in each field of each section that has it.
    """

    def __init__(self, sections: list[Section]) -> None:
        self.sections = sections
        counts = {
            (field, number): Counter(_tokenize(getattr(section, field)))
            for number, section in enumerate(sections)
            for field in FIELD_BOOSTS
        }
        holders = Counter(token for count in counts.values() for token in count)
        self.weights: dict[str, dict[int, float]] = defaultdict(lambda: defaultdict(float))
        for (field, number), count in counts.items():
            for token, times in count.items():
                rarity = (len(sections) - holders[token] + 0.5) / (holders[token] + 0.5)
                weight = math.log(1 + abs(rarity)) * (K1 + 1) * times / (K1 + times)
                boosted = weight * FIELD_BOOSTS[field] * sections[number].boost
                self.weights[token][number] += round(boosted, 3)

    def find_pages(self, query: str) -> list[str]:
        """Return the pages that a query finds, best first."""
        scores: dict[int, float] = defaultdict(float)
        matched: dict[int, set[str]] = defaultdict(set)
        words = [word for word in SEPARATOR.split(query.lower()) if word and word not in STOP_WORDS]
        words = [word for word in words if word not in ASKING] or words
        for word in words:
            for token, weights in self.weights.items():
                if token.startswith(word):
                    for number, weight in weights.items():
                        scores[number] += weight
                        matched[number].add(word)
        ranked = {
            number: score
            * (1 + (self.sections[number].first + len(matched[number]) / len(set(words))) ** 2)
            for number, score in scores.items()
        }
        order = sorted(ranked, key=lambda number: -ranked[number])
        return list(dict.fromkeys(self.sections[number].page for number in order))[:MOST_PAGES]


def _tokenize(text: str) -> Iterator[str]:
    for part in TAG.split(text):
        for token in SEPARATOR.split(part):
            if token and token.lower() not in STOP_WORDS:
                yield token.lower()


def _read_notebook(path: Path) -> str:
    cells = json.loads(path.read_text())["cells"]
    return "\n\n".join(
        "".join(cell["source"])
        if cell["cell_type"] == "markdown"
        else "```\n" + "".join(cell["source"]) + "\n```"
        for cell in cells
    )


def _split_page(page: str, text: str, boost: float) -> Iterable[Section]:
    """Return the sections of a page of Markdown."""
    text = re.sub(r"\A---\n.*?\n---\n", "", text, flags=re.S)
    parts, fenced = [["", ""]], False
    for line in text.splitlines():
        fenced ^= line.lstrip().startswith("```")
        heading = None if fenced else HEADING.match(line)
        if heading:
            parts.append([_plain(heading[1]), ""])
        elif not line.lstrip().startswith("```"):
            parts[-1][1] += (line if fenced else _plain(line)) + "\n"
    written = [part for part in parts if part[0] or part[1].strip()]
    for number, (title, body) in enumerate(written):
        yield Section(page, title, body, boost, number == 0)


def _plain(line: str) -> str:
    """Return a line of Markdown as the text of its page; code is set apart as by its tags."""
    line = TAG.sub("", LINK.sub(r"\1", line))
    line = re.sub(r"`([^`]*)`", r"<code>\1</code>", line)
    return re.sub(r"\*\*|(?<!\w)\*(?=\w)|(?<=\w)\*(?!\w)", "", line).replace("|", " ")
