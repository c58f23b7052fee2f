"""Pictures of docs/tutorial.md, by the commands that it shows:
``./headstock exec python3 docs/site/tutorial_pictures.py``.
"""

import re
import subprocess
import tempfile
from pathlib import Path

from PIL import Image

PROJECT = Path(__file__).resolve().parent.parent.parent
IMAGES = PROJECT / "docs" / "images"
SHELL = re.compile(r"^```sh\n(.*?)^```$", re.DOTALL | re.MULTILINE)
WIDTH = 1000  # of a picture [px]
# a picture of the document, and the file that the commands leave
PICTURES = {
    "tutorial_first": "first/results/figures/mode_reference_01.png",
    "tutorial_converge": "first/converge/convergence.png",
    "tutorial_part": "support.png",
    "tutorial_bracket": "bracket/results/figures/mode_reference_01.png",
    "tutorial_mill": "mill/mill.png",
    "tutorial_mode": "mill/results/figures/mode_reference_04.png",
    "tutorial_budget": "mill/results/figures/budget_reference_tcp.png",
}


def main() -> None:
    """Type the commands in a folder of their own and take the pictures along."""
    document = (PROJECT / "docs" / "tutorial.md").read_text()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for entry in ("headstock", "machines", "tests"):
            (folder / entry).symlink_to(PROJECT / entry)
        for commands in SHELL.findall(document):
            subprocess.run(["sh", "-eu", "-c", commands], cwd=folder, check=True)
        for picture, file in PICTURES.items():
            image = Image.open(folder / "tutorial" / file).convert("RGB")
            image.thumbnail((WIDTH, WIDTH))
            image.quantize(128).save(IMAGES / f"{picture}.png", optimize=True)


if __name__ == "__main__":
    main()
