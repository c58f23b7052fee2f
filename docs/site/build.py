"""The documentation as a site that opens from a folder: ``./headstock docs [-o DIR] [--quick]``."""

import argparse
import logging
import os
import sys
from pathlib import Path

import nbconvert
from mkdocs.commands.build import build
from mkdocs.config import load_config
from mkdocs.exceptions import Abort

PROJECT = Path(__file__).resolve().parent.parent.parent
MARK = ".headstock-site"  # MkDocs empties the folder of a site, but for hidden files


def main() -> int:
    """Build the site; 1 where a link or a page is broken."""
    parser = argparse.ArgumentParser(prog="headstock docs", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("site"), help="folder")
    parser.add_argument("--quick", action="store_true", help="notebooks without what they print")
    chosen = parser.parse_args()
    logging.basicConfig(level=logging.WARNING, format="%(message)s")
    output = chosen.output.absolute()
    mark = output / MARK
    if output.exists() and not mark.exists() and any(output.iterdir()):
        print(f"{output} holds other files; name a new folder with -o", file=sys.stderr)
        return 2
    output.mkdir(parents=True, exist_ok=True)
    mark.touch()
    os.chdir(PROJECT)
    # templates of notebooks lie beside the packages that pip installed
    os.environ["JUPYTER_PATH"] = str(Path(nbconvert.__file__).parent.parent / "share" / "jupyter")
    config = load_config(str(PROJECT / "mkdocs.yml"), site_dir=str(output))
    config["extra"]["quick"] = chosen.quick
    try:
        config.plugins.on_startup(command="build", dirty=False)
        build(config)
    except Abort as problem:
        print(f"the site was not built: {problem}", file=sys.stderr)
        return 1
    print(f"site in {output}: open {output / 'index.html'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
