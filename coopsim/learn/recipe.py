"""Recipes of trainings: everything but the seed that decides the weights, as plain data in a YAML file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

from coopsim.config.checked_entry import plain
from coopsim.config.load import load
from coopsim.config.yaml_file import Section, path_from, read_yaml
from coopsim.errors import CoopsimError, InvalidValueError
from coopsim.support.checks import (
    require_between,
    require_choice,
    require_count,
    require_non_negative,
    require_positive,
    require_probability,
)
from coopsim.support.precision import PRECISIONS
from coopsim.support.user_code import code_in, names_code, names_file

_FOLDER = Path(__file__).parent / "recipes"

RECIPES = tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))
"""Names of the shipped recipes."""


class Kind(NamedTuple):
    """A kind of training.

    Attributes:
        task: module and class of the task, in `coopsim.learn.tasks`.
        dt_s: time between two frames of its held-out clips.
        has_teacher: a recipe may name a teacher.
        has_maps: its heads read maps of points, so a recipe may name losses of a user.
    """

    task: str
    dt_s: float = 0.2
    has_teacher: bool = False
    has_maps: bool = False


KINDS: Mapping[str, Kind] = {
    "detector": Kind("detector_task.DetectorTask", dt_s=0.5, has_maps=True),
    "pictures": Kind("pictures_task.PicturesTask", dt_s=0.5),
    "points_and_pictures": Kind("pictures_task.PicturesTask", dt_s=0.5),
    "cooperative": Kind("cooperative_task.CooperativeTask", has_teacher=True, has_maps=True),
    "flow": Kind("cooperative_task.FlowTask", has_teacher=True, has_maps=True),
    "together": Kind("cooperative_task.TogetherTask", has_teacher=True, has_maps=True),
    "covariance": Kind("covariance_task.CovarianceTask"),
    "seen_covariance": Kind("covariance_task.SeenCovarianceTask"),
    "point_identity": Kind("identity_task.PointIdentityTask", has_teacher=True),
    "picture_identity": Kind("identity_task.PictureIdentityTask", dt_s=0.5),
    "queries": Kind("query_task.QueryTask"),
    "front": Kind("front_task.FrontTask", dt_s=0.5),
    "integrated": Kind("integrated_task.IntegratedTask"),
}
"""Stage A: an encoder with its head: of points, or of images, or of both beside one of points. Stage B: a fusion on a
frozen encoder, with flow also the change of messages in time. Stage C: both. A covariance of boxes is trained on
recordings; one that reads features, on clips. An identity tells objects apart. Queries are trained on a frozen encoder
and head, first of one agent, then of several; integrated detection and tracking on a frozen stage B. A front is trained
on frozen weights of stage A or B: the second look of their head."""


@dataclass(frozen=True, slots=True)
class TrainingRecipe:
    """A training.

    Attributes:
        name: name of the weights.
        kind: one of `KINDS`.
        steps: number of steps of the optimizer.
        batch: samples a step: agents' views for stage A, frames for B and C, windows of frames for covariances, groups
            of objects for an identity, clips for queries and integrated tracking.
        block: number of clips whose samples are shuffled together.
        passes: times that a block is used, each time with new random changes of its samples.
        lr: highest learning rate of the one-cycle schedule.
        weight_decay: weight decay of AdamW.
        clip: gradient clipping norm.
        average: decay of the moving average of the weights, which are saved.
        slower: factors on the learning rate of parameters, by the beginning of their names, such as "head": 0.1.
        loss: weights of parts of the loss, by name, that differ from `coopsim.learn.losses.head_losses.WEIGHTS`; with 0
            a part is shown and teaches nothing, such as "label": 0 to learn images without classes. A place,
            `file.py:Class` or `module:Class`, adds a part of yours, see `coopsim.learn.losses.own_losses`.
        precision: precision of the arithmetic, see `coopsim.support.precision`; the weights themselves are float32.
            "auto": that of `COOPSIM_PRECISION`, or else bfloat16 where the device has it.
        threads: threads of torch; only the same number of them gives the same bits.
        validate_every: steps between two validations; 0: never.
        held_out: number of clips of validation, see `coopsim.learn.loop.validation`.
        start: weights to begin with, by name or path; None: random ones.
        detector: weights that images are trained beside, and that stages B and C stand on, by name or path.
        teacher: weights of a detector of merged clouds that teaches stage B or C, by name or path, such as "early"; see
            `coopsim.learn.losses.fused_losses`. For an identity from points, the folder of a CLIP model in the format
            of `transformers`. None: no teacher.
        depths_first: share of the steps, at the beginning, in which an encoder of images learns depths and classes
            alone: these steps are quick, because no maps are made, and without depths maps have nothing to teach.
        network: options of the network: of `EncoderConfig`, `LiftSplatConfig` or `PointsAndPicturesConfig` for stage A,
            of `CooperativeConfig` for B and C; of `CovarianceConfig` for covariances; of `QueryConfig` for queries;
            of `IntegratedConfig` for integrated tracking.
        world: options of the clips, `WorldRecipe`, or `RecordedWorld` with kind: covariance.
        samples: options of the samples, `SampleSettings` or `SightingSettings`; none for covariances.
    """

    name: str
    kind: str = "detector"
    steps: int = 8000
    batch: int = 2
    block: int = 8
    passes: int = 1
    lr: float = 2e-3
    weight_decay: float = 0.01
    clip: float = 10.0
    average: float = 0.999
    slower: Mapping[str, float] = field(default_factory=dict)
    loss: Mapping[str, float] = field(default_factory=dict)
    precision: str = "auto"
    threads: int = 1
    validate_every: int = 0
    held_out: int = 12
    start: str | None = None
    detector: str = "pillars"
    teacher: str | None = None
    depths_first: float = 0.0
    network: Mapping[str, Any] = field(default_factory=dict)
    world: Mapping[str, Any] = field(default_factory=dict)
    samples: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and self.name.replace("-", "_").isidentifier()):
            raise InvalidValueError(f"name must be letters, digits, - and _, got {self.name!r}")
        require_choice("kind", self.kind, KINDS)
        require_choice("precision", self.precision, PRECISIONS)
        if self.teacher is not None and not KINDS[self.kind].has_teacher:
            raise InvalidValueError(
                f"teacher must be none with kind: {self.kind}, got {self.teacher!r}: it is for fusions, and for an "
                "identity from points"
            )
        self._check_losses()
        require_count(
            1,
            held_out=self.held_out,
            steps=self.steps,
            batch=self.batch,
            block=self.block,
            passes=self.passes,
            threads=self.threads,
        )
        require_count(0, validate_every=self.validate_every)
        require_positive(lr=self.lr, clip=self.clip)
        require_non_negative(weight_decay=self.weight_decay)
        require_probability(average=self.average, depths_first=self.depths_first)
        for each in ("slower", "loss", "network", "world", "samples"):
            if not isinstance(getattr(self, each), Mapping):
                raise InvalidValueError(f"{each} must be names and values, got {getattr(self, each)!r}")
        for name, factor in self.slower.items():
            require_between(0, 1, **{f"slower {name}": factor})

    def _check_losses(self) -> None:
        require_non_negative(**{f"loss {name}": weight for name, weight in self.loss.items()})
        own = next(filter(names_code, self.loss), None)
        if own is not None and not KINDS[self.kind].has_maps:
            kinds = ", ".join(name for name, kind in KINDS.items() if kind.has_maps)
            raise InvalidValueError(f"loss {own!r} must be left out with kind: {self.kind}; accepted: with {kinds}")

    def as_data(self) -> dict[str, Any]:
        """Return the recipe as plain data."""
        return {name: plain(value) for name, value in asdict(self).items()}

    def changed(self, **options: Any) -> TrainingRecipe:
        """Return the recipe with other values; "world.density" is a key in a mapping.

        Raises:
            UnknownNameError: there is no such option.
            InvalidValueError: a value is not accepted.
        """
        given: dict[str, Any] = {}
        for name, value in options.items():
            outer, dot, inner = name.partition(".")
            if dot and isinstance(getattr(self, outer, None), Mapping):
                value = {**given.get(outer, getattr(self, outer)), inner: value}
            require_choice("recipe option", outer if dot else name, [each.name for each in fields(self)])
            given[outer] = value
        return replace(self, **given)


def find_recipe(recipe: TrainingRecipe | str | Path, *, trust: bool = False) -> TrainingRecipe:
    """Return a recipe by the name of a shipped one or the path of a YAML file.

    `trust` lets a file name code to run, as the place of a fusion or a loss, `file.py:Class`, which is relative to the
    file.

    Raises:
        UnknownNameError: there is no such recipe, or a key is unknown.
        InvalidValueError: the file is missing or broken, names code without `trust`, or a value is not accepted; names
            the line.
    """
    if isinstance(recipe, TrainingRecipe):
        return recipe
    path = Path(recipe)
    if path.suffix not in (".yaml", ".yml"):
        require_choice("recipe", str(recipe), RECIPES)
        path = _FOLDER / f"{recipe}.yaml"
    content = read_yaml(path, InvalidValueError).value
    if not isinstance(content, Section):
        raise InvalidValueError(f"{path}: a recipe must be names and values, got {content!r}")
    content.setdefault("name", path.stem)
    _place_code(content, path, trust)
    try:
        made = load(TrainingRecipe, content, "recipe")
    except CoopsimError as error:
        raise error.at(content.blame(error) or str(path)) from error
    assert isinstance(made, TrainingRecipe)
    return made


def _place_code(content: Section, path: Path, trust: bool) -> None:
    """Refuse code that a file names without trust, and find files of a fusion and of losses beside the recipe's."""
    for key, value in content.items():
        if (code := code_in(value)) is not None and not trust:
            problem = f"a recipe's file names code to run, {code!r}: give it by --option, or add --trust"
            raise InvalidValueError(problem).at(content.place(key))
    network, losses = content.get("network"), content.get("loss")
    if isinstance(network, Mapping) and isinstance(fusion := network.get("fusion"), str):
        content["network"]["fusion"] = _beside(path, fusion)
    if isinstance(losses, Mapping):
        for name in [name for name in losses if names_file(str(name))]:
            content["loss"][_beside(path, name)] = content["loss"].pop(name)


def _beside(path: Path, name: str) -> str:
    """Return the place of code in a file, which is relative to that of the recipe; other names as they are."""
    if not names_file(name):
        return name
    file, _, name = name.rpartition(":")
    return f"{path_from(path.parent, file)}:{name}"
