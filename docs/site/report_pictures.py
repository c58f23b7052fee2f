"""Pictures of charts in reports, of machines and validation cases:
``python3 docs/site/report_pictures.py [NAME ...]``, outside of the environment: it needs a chromium
beside ``./headstock``, and nothing but Python.
"""

import argparse
import base64
import json
import os
import shlex
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PROJECT = Path(__file__).resolve().parent.parent.parent
HEADSTOCK = PROJECT / "headstock"
SCALE, SHADED_SCALE = 1.5, 1.1  # pixels of the picture per pixel of charts, and of machines
HEIGHT = 1100  # of the window [px]
SECONDS = 120.0  # for a report to be drawn
# shapes of the machine are drawn one after the other, small ones beside the list; the first is at rest
DRAWN = """document.readyState === "complete"
    && [...document.querySelectorAll("#shapes .frame")].slice(1).every((frame) => frame.firstElementChild)"""


@dataclass(frozen=True)
class Shot:
    """A part of a report.

    Attributes:
        command: What makes the report's folder, without ``./headstock`` and ``-o``.
        page: That it writes; a report without it.
        keep: CSS selectors of elements, and of the children that they keep.
        shape: Of the machine, by the name in its list; what the report shows first without it.
        click: CSS selectors of what is clicked then.
        width: Of the window [px].
    """

    command: str
    keep: tuple[tuple[str, str], ...]
    page: str = ""
    shape: str = ""
    click: tuple[str, ...] = ()
    width: int = 1240


@dataclass(frozen=True)
class Output:
    """A picture that a command writes.

    Attributes:
        command: Without ``./headstock`` and ``-o``.
        file: What ``-o`` takes, or has in it.
        share: Of its height that is taken, from the top.
        before: Commands that make what it needs; ``FOLDER`` in commands is a temporary one.
    """

    command: str
    file: str
    share: float = 1.0
    before: tuple[str, ...] = ()


CORRELATE = "correlate machines/three_axis.toml machines/three_axis_test.uff --variant calibrated+YCE --pose measured"
PICTURES: dict[str, Shot | Output] = {
    "report": Shot(
        "run machines/three_axis.toml --analysis static --analysis modal",
        ((".page", "header, nav, .soft, .keys, .text, #machine"),),
        shape="y_base twists B",
    ),
    "tripteor_elastic_legs": Shot(
        "run machines/tripteor.toml --variant elastic_legs+segmented --analysis modal",
        (
            (".page", "#machine"),
            ("#machine", ".machine"),
            (".machine > div", ".stage-frame, .side *"),
        ),
        shape="beam_1..2 bend Z",
        click=("#show-joints",),
    ),
    "path": Shot(
        "run machines/three_axis.toml --variant calibrated+BE --analysis path",
        ((".page", "#path"), ("#path", "h2, .lead, .block"), (".block", "h3, svg")),
    ),
    "lobes": Shot(
        "run machines/three_axis.toml --variant R --analysis lobes",
        (
            (".page", "#lobes"),
            ("#lobes", ".block"),
            (".block", ".fields"),
            (".fields > div", "svg"),
        ),
        width=700,
    ),
    "correlation": Shot(
        CORRELATE,
        (
            (".page", "#pairs, #machine"),
            ("#pairs", "h2, .scroll"),
            ("#machine", ".machine"),
            (".machine > div", ".stage-frame, .side, .side *"),
        ),
        page="correlate.html",
        shape="162",
        click=("#show-joints",),
    ),
    "correlation_mac": Output(CORRELATE, "mac.png"),
    "correlation_responses": Output(CORRELATE, "responses.png"),
    # from two of four sides
    "show": Output("show machines/three_axis.toml --pose measured", "machine.png", share=0.513),
    "assembly": Output(
        "show FOLDER/mill/mill.toml",
        "machine.png",
        share=0.566,
        before=(
            "exec python3 machines/assembly/write_assembly.py FOLDER/mill.step",
            "new FOLDER/mill --assembly FOLDER/mill.step",
        ),
    ),
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
                if not wanted.page:
                    run_headstock("report", str(folder / "results"))
                page = folder / "results" / (wanted.page or "report.html")
                picture, share = photograph(page, wanted), 1.0
            else:
                picture, share = folder / wanted.file, wanted.share
                target = picture if wanted.command.startswith("show ") else folder
                for command in wanted.before:
                    run_headstock(*shlex.split(command.replace("FOLDER", str(folder))))
                command = wanted.command.replace("FOLDER", str(folder))
                run_headstock(*shlex.split(command), "-o", str(target))
            saving = ["docs/site/saving.py", str(picture), name, "--share", str(share)]
            shaded = isinstance(wanted, Shot) and wanted.shape
            run_headstock("exec", "python3", *saving, *(["--shaded"] if shaded else []))


def run_headstock(*words: str) -> None:
    """A command of this checkout."""
    subprocess.run([HEADSTOCK, *words], cwd=PROJECT, check=True)


def photograph(report: Path, shot: Shot) -> Path:
    """A part of a report as chromium shows it, on white."""
    rules = ["body { background: #fff; } section { border: 0; padding: 0; }"]
    rules += [
        f":is({outer}) > :not({kept}) {{ display: none !important; }}" for outer, kept in shot.keep
    ]
    page, picture = report.with_name("picture.html"), report.with_name("picture.png")
    style = f"<style>{' '.join(rules)}</style></head>"
    page.write_text(report.read_text().replace("</head>", style, 1))
    with open_browser(shot.width, SHADED_SCALE if shot.shape else SCALE) as browser:
        # animations stand still
        still = [{"name": "prefers-reduced-motion", "value": "reduce"}]
        browser.send("Emulation.setEmulatedMedia", features=still)
        browser.send("Page.navigate", url=page.as_uri())
        browser.wait_for(DRAWN)
        if shot.shape:
            wanted = f"(item) => item.innerText.includes({json.dumps(shot.shape)})"
            browser.ask(f'[...document.querySelectorAll("#shapes .shape")].find({wanted}).click()')
        for selector in shot.click:
            browser.ask(f"document.querySelector({json.dumps(selector)}).click()")
        # what was clicked is drawn in the next frames
        browser.ask("new Promise((done) => setTimeout(done, 1000))")
        shown = browser.send("Page.captureScreenshot", captureBeyondViewport=True)
    picture.write_bytes(base64.b64decode(shown["data"]))
    return picture


class Browser:
    """A page of chromium, which is told what to do through a pair of pipes: commands of its DevTools
    protocol as JSON, each ended by a zero byte.
    """

    def __init__(self, told: int, said: int) -> None:
        self._told, self._said = told, os.fdopen(said, "rb")
        self._count, self._session = 0, {}
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        attached = self.send("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        """What the browser answers to a command.

        Raises:
            SystemExit: It answers with an error, or not any more.
        """
        self._count += 1
        command = {"id": self._count, "method": method, "params": parameters, **self._session}
        os.write(self._told, json.dumps(command).encode() + b"\0")
        while (answer := self._read()).get("id") != self._count:
            pass
        if "error" in answer:
            raise SystemExit(f"chromium refuses {method}: {answer['error']}")
        return dict(answer["result"])

    def ask(self, script: str) -> Any:
        """The value of an expression in the page, which may be a promise."""
        found = self.send(
            "Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True
        )
        if "exceptionDetails" in found:
            raise SystemExit(f"{script}: {found['exceptionDetails']}")
        return found["result"].get("value")

    def wait_for(self, condition: str) -> None:
        """Wait until an expression is true.

        Raises:
            SystemExit: It is not in time.
        """
        end = time.monotonic() + SECONDS
        while not self.ask(condition):
            if time.monotonic() > end:
                raise SystemExit(f"not drawn after {SECONDS:g} s")
            time.sleep(0.2)

    def _read(self) -> dict[str, Any]:
        text = bytearray()
        while (byte := self._said.read(1)) != b"\0":
            if not byte:
                raise SystemExit("chromium ended")
            text += byte
        return dict(json.loads(text))


@contextmanager
def open_browser(width: int, scale: float) -> Iterator[Browser]:
    """A page in a window of its own, of a width [px] and so many pixels of the picture for each.

    Raises:
        SystemExit: There is no chromium.
    """
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("no chromium: install it, or name pictures that are no reports")
    (hears, told), (said, says) = os.pipe(), os.pipe()
    words = [
        *(chromium, "--headless", "--no-sandbox", "--hide-scrollbars", "--remote-debugging-pipe"),
        *(f"--window-size={width},{HEIGHT}", f"--force-device-scale-factor={scale}"),
    ]
    # it listens to descriptor 3 and speaks on 4
    command = f"exec {shlex.join(words)} 3<&{hears} 4>&{says}"
    with subprocess.Popen(
        command, shell=True, pass_fds=(hears, says), stderr=subprocess.DEVNULL
    ) as process:
        os.close(hears)
        os.close(says)
        try:
            yield Browser(told, said)
        finally:
            process.terminate()
            os.close(told)


if __name__ == "__main__":
    main()
