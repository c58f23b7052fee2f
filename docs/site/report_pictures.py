"""Pictures of charts in reports, of machines and validation cases:
``python3 docs/site/report_pictures.py [NAME ...]``, outside of the environment: it needs a chromium
beside ``./headstock``, and nothing but Python.
"""

import argparse
import shlex
import shutil
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path

PROJECT = Path(__file__).resolve().parent.parent.parent
HEADSTOCK = PROJECT / "headstock"
SCALE = 1.5  # pixels of the picture per pixel of a report
TALLEST = 1600  # part of a report [px]
DRAW_MS = 15000
SECONDS = 600


@dataclass(frozen=True)
class Shot:
    """A part of a report.

    Attributes:
        command: What makes the report's folder, without ``./headstock`` and ``-o``.
        keep: CSS selectors of elements, and of the children that they keep.
        width: Of the window [px].
    """

    command: str
    keep: tuple[tuple[str, str], ...]
    width: int = 1240


@dataclass(frozen=True)
class Output:
    """A picture that a command writes.

    Attributes:
        command: Without ``./headstock`` and ``-o``.
        file: What ``-o`` takes, or has in it.
        share: Of its height that is taken, from the top.
    """

    command: str
    file: str
    share: float = 1.0


PICTURES: dict[str, Shot | Output] = {
    "path": Shot(
        "run machines/three_axis.toml --variant calibrated+BE --analysis path",
        ((".page", "#path"), ("#path", "h2, .lead, .block"), (".block", "h3, svg")),
    ),
    "lobes": Shot(
        "run machines/three_axis.toml --variant R --analysis lobes",
        ((".page", "#lobes"), ("#lobes", ".block"), (".block", "svg")),
    ),
    # from two of four sides
    "show": Output("show machines/three_axis.toml --pose measured", "machine.png", share=0.513),
    "axis_construction_kit": Output("validate axis_construction_kit", "axis_construction_kit.png"),
}


def main() -> None:
    """Run the commands and take the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="of pictures; all without them")
    for name in parser.parse_args().names or PICTURES:
        wanted = PICTURES[name]
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            if isinstance(wanted, Shot):
                run_headstock(*shlex.split(wanted.command), "-o", str(folder / "results"))
                run_headstock("report", str(folder / "results"))
                picture, share = photograph(folder / "results" / "report.html", wanted), 1.0
            else:
                picture, share = folder / wanted.file, wanted.share
                target = picture if wanted.command.startswith("show ") else folder
                run_headstock(*shlex.split(wanted.command), "-o", str(target))
            saving = "docs/site/saving.py", str(picture), name, "--share", str(share)
            run_headstock("exec", "python3", *saving)


def run_headstock(*words: str) -> None:
    """A command of this checkout."""
    subprocess.run([HEADSTOCK, *words], cwd=PROJECT, check=True)


def photograph(report: Path, shot: Shot) -> Path:
    """A part of a report as chromium shows it, on white.

    Raises:
        SystemExit: There is no chromium.
    """
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("no chromium: install it, or name pictures that are no reports")
    rules = ["body { background: #fff; } section { border: 0; padding: 0; }"]
    rules += [
        f":is({outer}) > :not({kept}) {{ display: none !important; }}" for outer, kept in shot.keep
    ]
    page, picture = report.with_name("picture.html"), report.with_name("picture.png")
    style = f"<style>{' '.join(rules)}</style></head>"
    page.write_text(report.read_text().replace("</head>", style, 1))
    subprocess.run(
        [
            *(chromium, "--headless", "--no-sandbox", "--hide-scrollbars"),
            *(f"--window-size={shot.width},{TALLEST}", f"--force-device-scale-factor={SCALE}"),
            *(f"--timeout={DRAW_MS}", f"--screenshot={picture}"),
            page.as_uri(),
        ],
        check=True,
        timeout=SECONDS,
        capture_output=True,
    )
    return picture


if __name__ == "__main__":
    main()
