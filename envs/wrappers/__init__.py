"""Wrappers that give learners observations and actions of fixed shapes.

All but `Driving`, `Speaking` and `WithoutInfos` take the parallel environment (`coopsim.parallel_env`) as well as the
single-agent one (`coopsim.single_env`, `gymnasium.make`), and return a wrapper of the same kind.

| wrapper | observations | actions |
|---|---|---|
| `FixedSize` | the nearest or surest boxes in rows of fixed number: a `Dict` of `Box` | |
| `DrivingRows` | a car's motion, route and nearest tracks: a `Dict` of `Box` | |
| `BevImage` | a square picture around the agent: a `Box` (C, H, W) | |
| `Flatten` | all of these as one (N,) `Box`; a picture by itself stays one | |
| `Driving` | | maneuvers alone, a `Discrete`; a policy tracks |
| `Speaking` | | messages alone, as one (N,) `Box`; a policy tracks |
| `FixedTracks` | | tracks, and the maneuver of a driver, as one (N,) `Box` |
| `WithoutInfos` | the same, and empty infos, as TorchRL needs them | |

`FixedSize`, `DrivingRows` and `BevImage` around each other give a `Dict` with the arrays of all. What changes actions
comes first:

```python
env = coopsim.parallel_env("crossing", control="policy")
env = Flatten(FixedSize(Driving(env, tracker="late_fusion"), detections=16, order="surest"))
```

No truth is in any of it: all comes from the agent's own observation, and the map is placed by its estimated pose.
`DrivingRows` shows what a planner is given: its tracker's tracks, its car's own motion, and the route.
"""

from __future__ import annotations

from typing import Any

import gymnasium

from coopsim.envs.options import sort_options
from coopsim.envs.wrappers.base_wrappers import (
    ActingParallel,
    ActingSingle,
    ActionForm,
    ObservationForm,
    ObservingParallel,
    ObservingSingle,
    cooperative_env,
)
from coopsim.envs.wrappers.bev_image import BevImageView
from coopsim.envs.wrappers.driving_rows import DrivingRowsView
from coopsim.envs.wrappers.driving_wrapper import Driving, Speaking
from coopsim.envs.wrappers.fixed_size import FixedSizeView
from coopsim.envs.wrappers.flat import FlatForm, WithoutInfos
from coopsim.envs.wrappers.received import View, Views
from coopsim.envs.wrappers.track_rows import TrackRows

__all__ = ["BevImage", "Driving", "DrivingRows", "FixedSize", "FixedTracks", "Flatten", "Speaking", "WithoutInfos"]


def FixedSize(env: Any, **options: Any) -> Any:
    """Show the nearest or surest boxes in rows of fixed number; see `coopsim.envs.wrappers.fixed_size`.

    Args:
        env: a parallel or single-agent environment.
        **options: fields of `FixedSizeView`: `detections`, `messages`, `received`, `points`, `order`, `reach_m`.

    Returns:
        A wrapper of the same kind. It shows a dict of float32 arrays in the agent's base frame (m, s, rad, m/s): `own`
        (12,), which has the estimated pose in the world frame, `detections` (32, 18), `messages` (8, 9), `received`
        (8, 16, 20) and, if asked for, `points` (points, 4); and with each but `own` a mask, as `detections_mask` (32,):
        1 for a row with content, 0 for padding.

    Raises:
        InvalidValueError: a value is not accepted, or `env` has other observations than coopsim's.
        UnknownNameError: there is no such option or order; the message lists those that there are.
    """
    return _viewed(env, _made(FixedSizeView, options))


def DrivingRows(env: Any, **options: Any) -> Any:
    """Show the knowledge by which a car drives: its motion, its route, its tracks; see `driving_rows`.

    Args:
        env: a single-agent environment with `control="acceleration"` and a `tracker`, or `Driving` around a parallel
            one with such control.
        **options: fields of `DrivingRowsView`: `tracks`, `points`, `ahead_m`, `reach_m`.

    Returns:
        A wrapper of the same kind. It shows a dict of float32 arrays in [-1, 1]: `car` (4,), `route` (10, 4), `tracks`
        (16, 20), and `tracks_mask` (16,): 1 for a row with a track, 0 for padding.

    Raises:
        InvalidValueError: a value is not accepted, or `env` has no cars that accelerations drive, or no tracker.
        UnknownNameError: there is no such option; the message lists those that there are.
    """
    return _viewed(env, _made(DrivingRowsView, options))


def BevImage(env: Any, **options: Any) -> Any:
    """Show a square picture around the agent, heading up; see `coopsim.envs.wrappers.bev_image`.

    Args:
        env: a parallel or single-agent environment.
        **options: fields of `BevImageView`: `size`, `metres`, `channels`, `dtype`.

    Returns:
        A wrapper of the same kind. It shows a picture (planes, size, size), uint8 from 0 to 255 or float32 from 0 to 1,
        by default (16, 128, 128) with pixels of 0.75 m: row 0 is farthest ahead, column 0 farthest to the left. With
        `FixedSize` it is the array `picture` of the dict.

    Raises:
        InvalidValueError: a value is not accepted, or `env` has other observations than coopsim's.
        UnknownNameError: there is no such option, channel or dtype; the message lists those that there are.
    """
    return _viewed(env, _made(BevImageView, options))


def Flatten(env: Any) -> Any:
    """Show all arrays of an observation as one (N,) float32 array; a picture by itself stays one.

    Args:
        env: a parallel or single-agent environment within `FixedSize`, `DrivingRows`, `BevImage` or several of them.

    Raises:
        InvalidValueError: `env` has observations of no fixed shape.
    """
    return _observing(env, FlatForm())


def FixedTracks(env: Any, **options: Any) -> Any:
    """Take tracks as numbers in [-1, 1]; see `coopsim.envs.wrappers.track_rows`.

    Args:
        env: a parallel or single-agent environment.
        **options: fields of `TrackRows`: `tracks`, `reach_m`.

    Raises:
        InvalidValueError: a value is not accepted, or `env` has other actions than coopsim's.
        UnknownNameError: there is no such option; the message lists those that there are.
    """
    form: ActionForm = _made(TrackRows, options)
    return ActingSingle(env, form) if isinstance(env, gymnasium.Env) else ActingParallel(env, form)


def _made(kind: type[Any], options: dict[str, Any]) -> Any:
    (known,) = sort_options(options, kind)
    return kind(**known)


def _viewed(env: Any, view: View) -> Any:
    """Show a view; around other views, both."""
    if isinstance(env, (ObservingParallel, ObservingSingle)) and isinstance(env.form, Views):
        return _observing(env.env, Views([*env.form.views, view]))
    return _observing(env, Views([view]))


def _observing(env: Any, form: ObservationForm) -> Any:
    cooperative_env(env)
    return ObservingSingle(env, form) if isinstance(env, gymnasium.Env) else ObservingParallel(env, form)
