"""Draw every model of vehicles and people, in colours of actors, to actors.png (or the path given)."""

import sys

import numpy as np

from coopsim.viz.portrait import contact_sheet, portrait
from coopsim.world.models import make_models
from coopsim.world.models.paint import draw_colors

models = make_models()
label = np.array([model.label for model in models])
color, accent = draw_colors(98, 1 + np.arange(len(models)), label)
pictures = [
    (model.name, portrait(model, *paints, size_px=(144, 108)))
    for model, *paints in zip(models, color, accent, strict=True)
]
path = sys.argv[1] if len(sys.argv) > 1 else "actors.png"
contact_sheet(pictures, columns=8).save(path, optimize=True)
print(f"{len(models)} models in {path}")
