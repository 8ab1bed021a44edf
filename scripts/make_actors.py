"""Write the built-in models of vehicles and people, which coopsim reads, and their card.

    python scripts/make_actors.py [--out coopsim/world/models]

The models are the same on every processor, to the bit; the file's own digest, which the card has, may differ between
versions of zlib. `coopsim/world/models/built_in.py` has the layout.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from actor_shapes import make_actors
from numpy.typing import NDArray

from coopsim.world.models.built_in import ACTORS
from coopsim.world.models.model import Model


def table_of(actors: Mapping[str, Sequence[Model]]) -> dict[str, NDArray[Any]]:
    """Return the arrays of the file: a row for each model, the parts of all end to end, and the surfaces."""
    models = [model for group in actors.values() for model in group]
    surfaces = np.concatenate(
        [np.column_stack([m.tint, m.reflectivity, m.accented, m.color.astype(np.float64)]) for m in models]
    )
    rows, surface = np.unique(surfaces, axis=0, return_inverse=True)
    return {
        "name": np.array([model.name for model in models]),
        "group": np.array([name for name, group in actors.items() for _ in group]),
        "label": np.array([model.label for model in models], dtype=np.uint8),
        "size_m": np.array([model.size_m for model in models]),
        "cycle_m": np.array([model.cycle_m for model in models]),
        "share": np.array([model.share for model in models]),
        "stands": np.array([model.stands for model in models]),
        "counts": np.array([(*model.poses.shape[:2], len(model.faces)) for model in models], dtype=np.uint16),
        "points": np.concatenate([model.poses.reshape(-1, 3) for model in models]),
        "faces": np.concatenate([model.faces for model in models]).astype(np.uint16),
        "surface": surface.reshape(-1).astype(np.uint8),
        "tint": rows[:, 0],
        "reflectivity": rows[:, 1],
        "accented": rows[:, 2] > 0,
        "color": rows[:, 3:].astype(np.uint8),
    }


def card_of(path: Path) -> str:
    """Return the card of a written file."""
    content = path.read_bytes()
    card = {
        "name": path.stem,
        "command": "python scripts/make_actors.py",
        "digest": hashlib.sha256(content).hexdigest(),
        "bytes": len(content),
        "numpy": np.__version__,
    }
    return json.dumps(card, indent=2) + "\n"


def main() -> None:
    """Write both files."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ACTORS.parent, help="folder; default: where coopsim reads them")
    path = parser.parse_args().out / ACTORS.name
    np.savez_compressed(path, **table_of(make_actors()))
    path.with_suffix(".json").write_text(card_of(path))


if __name__ == "__main__":
    main()
