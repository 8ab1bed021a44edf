"""Draw the plain models of vehicles and people, or with `varied` the variants, in colours of actors, to a picture."""

import sys

import numpy as np

from coopsim.viz.portrait import contact_sheet, portrait
from coopsim.world.models import make_models
from coopsim.world.models.paint import draw_colors

path, *which = sys.argv[1:] or ["actors.png"]
plain = make_models()
models = make_models(varied=True)[len(plain) :] if which == ["varied"] else plain
label = np.array([model.label for model in models])
color, accent = draw_colors(98, 1 + np.arange(len(models)), label)
pictures = [
    (model.name, portrait(model, *paints, size_px=(144, 108)))
    for model, *paints in zip(models, color, accent, strict=True)
]
contact_sheet(pictures, columns=8).save(path, optimize=True)
print(f"{len(models)} models in {path}")
