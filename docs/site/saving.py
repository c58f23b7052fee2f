"""Pictures as the documents have them: ``./headstock exec python3 docs/site/saving.py PNG NAME``."""

import argparse
from pathlib import Path

import numpy as np
from PIL import Image

IMAGES = Path(__file__).resolve().parent.parent / "images"
COLORS = 256
REFINEMENTS = 3
MARGIN = 12  # of white around what is seen [px]
WHITE = 250  # of 255


def main() -> None:
    """Save a picture without the white around it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("picture", type=Path)
    parser.add_argument("name", help="in docs/images, without .png")
    parser.add_argument("--share", type=float, default=1.0, help="of its height, from the top")
    parser.add_argument("--shaded", action="store_true", help="keep all colours")
    chosen = parser.parse_args()
    image = Image.open(chosen.picture).convert("RGB")
    upper = image.crop((0, 0, image.width, round(chosen.share * image.height)))
    kept = _crop_margins(upper)
    if not chosen.shaded:
        kept = kept.quantize(COLORS, kmeans=REFINEMENTS)
    kept.save(IMAGES / f"{chosen.name}.png", optimize=True)


def _crop_margins(image: Image.Image) -> Image.Image:
    seen = np.argwhere((np.asarray(image) < WHITE).any(axis=2))
    top, left = (int(place) - MARGIN for place in seen.min(axis=0))
    bottom, right = (int(place) + MARGIN + 1 for place in seen.max(axis=0))
    return image.crop(
        (max(left, 0), max(top, 0), min(right, image.width), min(bottom, image.height))
    )


if __name__ == "__main__":
    main()
