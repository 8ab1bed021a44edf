"""The built-in models of vehicles and people, read from `actors.npz`.

`scripts/make_actors.py` makes that file and its card, `actors.json`. Data only, no code.
"""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coopsim.world.models.model import Model

ACTORS = Path(__file__).with_name("actors.npz")
"""Arrays over all N models, and of the parts of all, end to end in the order of the models.

- `name`, `group`, `label`, `cycle_m`, `share`, `stands` (N,), `size_m` (N, 3): see `coopsim.world.models.Model`.
- `counts` (N, 3): poses K, vertices V and faces F of each model.
- `points` (sum of K V, 3): poses, one after another. `faces`, `surface` (sum of F): vertices, and a row of the next.
- `tint`, `reflectivity`, `accented` (S,), `color` (S, 3): surfaces.
"""

GROUPS = ("plain", "varied", "standing", "sitting")
"""Models of all places, their variants, and people at rest."""


@cache
def built_in_models(group: str) -> tuple[Model, ...]:
    """Return the models of a group; the file is read at the first call."""
    table, (points_from, faces_from) = _read()
    chosen = np.flatnonzero(table["group"] == group).tolist()
    return tuple(_model(table, k, int(points_from[k]), int(faces_from[k])) for k in chosen)


@cache
def _read() -> tuple[dict[str, NDArray[Any]], NDArray[np.int64]]:
    """Return the file's arrays, and the rows (2, N) at which each model's points and faces begin."""
    with np.load(ACTORS, allow_pickle=False) as file:
        table = {name: file[name] for name in file.files}
    poses, vertices, faces = table["counts"].T.astype(np.int64)
    sizes = np.stack([poses * vertices, faces])
    return table, np.cumsum(sizes, axis=1) - sizes


def _model(table: dict[str, NDArray[Any]], k: int, points_from: int, faces_from: int) -> Model:
    poses, vertices, faces = (int(count) for count in table["counts"][k])
    points = table["points"][points_from : points_from + poses * vertices].reshape(poses, vertices, 3)
    here = slice(faces_from, faces_from + faces)
    surface = table["surface"][here]
    return Model(
        str(table["name"][k]),
        int(table["label"][k]),
        table["size_m"][k],
        points[0],
        table["faces"][here].astype(np.int64),
        table["tint"][surface],
        table["reflectivity"][surface],
        table["color"][surface],
        table["accented"][surface],
        points,
        float(table["cycle_m"][k]),
        float(table["share"][k]),
        bool(table["stands"][k]),
    )
