"""What MkDocs is told about these documents: notebooks become pages with what they print, and
links to files beside the documents become their names.
"""

import re
import sys
from pathlib import Path, PurePosixPath

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbclient import NotebookClient
from nbconvert import MarkdownExporter

OUTSIDE = re.compile(r"\[([^\]]*)\]\(\.\./(?:\.\./)*([^)#]*)(#[^)]*)?\)")
CELL_SECONDS = 600
PAGES_A_LINE = 10  # that are written between two lines of progress
INLINE_CODE = re.compile(r"(?<=<code>)[^<\n]*(?=</code>)")
BETWEEN_FOLDERS = re.compile(r"(?<=\w)/(?=\w)")
ROW = re.compile(r"^\|.*$", re.MULTILINE)
BEFORE_UNIT = re.compile(
    r"(?<=\d) (?=%|(?:\d{3}|[kMG]?Hz|[mkM]?N|[µmk]?m|m?s|[MG]B|kg|dofs|times)\b)"
)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Put the pages and pictures of notebooks in place of the notebooks."""
    notebooks = [file for file in files if file.src_uri.endswith(".ipynb")]
    for number, file in enumerate(notebooks, 1):
        report(f"notebook {number} of {len(notebooks)}: {file.name}")
        files.remove(file)
        page, pictures = render_notebook(Path(str(file.abs_src_path)), quick=config.extra["quick"])
        place = PurePosixPath(file.src_uri)
        files.append(File.generated(config, str(place.with_suffix(".md")), content=page))
        for name, content in pictures.items():
            files.append(File.generated(config, str(place.parent / name), content=content))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Links that leave the documents: the start page for the README, else the name of the file. In
    tables numbers keep their units beside them. The kind of page decides how early search lists it.
    """
    pages = files.documentation_pages()
    if (number := pages.index(page.file) + 1) % PAGES_A_LINE == 0 or number == len(pages):
        report(f"page {number} of {len(pages)}")
    if page.ancestors:
        boosts = config.extra["search_boost"]
        kind = boosts.get(page.ancestors[-1].title, 1)
        page.meta.setdefault("search", {})["boost"] = boosts.get(page.file.name, kind)
    depth = len(PurePosixPath(page.file.src_uri).parents) - 1

    def rewrite(found: re.Match[str]) -> str:
        text, target, anchor = found.group(1), found.group(2), found.group(3) or ""
        name = target.removeprefix("docs/")
        if name != target or files.get_file_from_path(target) is not None:
            return f"[{text}]({'../' * depth}{name}{anchor})"
        if target == "README.md":
            return f"[{text}]({'../' * depth}index.md)"
        return f"{text} (`{target}`)" if text.strip("`") != target else text

    return OUTSIDE.sub(rewrite, ROW.sub(keep_units, markdown))


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Names of files break after a slash where they break."""
    return INLINE_CODE.sub(lambda found: BETWEEN_FOLDERS.sub("/<wbr>", found.group()), html)


def report(text: str) -> None:
    """Say how far the site is."""
    print(text, file=sys.stderr, flush=True)


def keep_units(row: re.Match[str]) -> str:
    """A row of a table with a space that does not break before units, but in code."""
    parts = re.split(r"(`[^`]*`)", row.group())
    return "".join(part if part[:1] == "`" else BEFORE_UNIT.sub("\u00a0", part) for part in parts)


def render_notebook(path: Path, *, quick: bool) -> tuple[str, dict[str, bytes]]:
    """A notebook as Markdown, with its pictures by name.

    Args:
        path: The notebook.
        quick: Do not run it.
    """
    notebook = nbformat.read(path, as_version=4)
    if not quick:
        NotebookClient(
            notebook,
            timeout=CELL_SECONDS,
            resources={"metadata": {"path": str(path.parent)}},
            extra_arguments=["--log-level=ERROR"],
        ).execute()
    text, resources = MarkdownExporter().from_notebook_node(
        notebook, resources={"unique_key": path.stem, "output_files_dir": f"{path.stem}_files"}
    )
    return text, dict(resources.get("outputs", {}))
