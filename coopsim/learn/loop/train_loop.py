"""The loop of a training: steps of the optimizer, with checkpoints, log and validation between them."""

from __future__ import annotations

import copy
import math
import signal
import statistics
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from coopsim.errors import TrainingError
from coopsim.learn.loop.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from coopsim.learn.loop.training_log import TrainingLog
from coopsim.learn.losses.head_losses import sum_of
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.batches_ahead import BatchesAhead
from coopsim.learn.samples.sample_order import Position, SampleOrder
from coopsim.learn.tasks.training_task import LOSS, AnyTask
from coopsim.nn.inference.backend import numbers_on, to_device

SAVE_EVERY_S = 60.0
"""Time between two checkpoints."""

_REMEMBERED, _LEAST, _TOO_LARGE, _PATIENCE = 500, 50, 9.0, 50

Validate = Callable[[nn.Module], Mapping[str, float]]
"""Validation of the averaged network: returns values by name, such as "AP"."""


@dataclass(frozen=True, slots=True)
class TrainingProgress:
    """Progress of a training.

    Attributes:
        step: number of steps taken, those before an interruption included.
        steps: number of steps of the whole training.
        losses: losses of the last step, by name.
        validation: last values of held-out clips, by name; empty before the first.
        left_s: estimated time that is left.
    """

    step: int
    steps: int
    losses: Mapping[str, float]
    validation: Mapping[str, float]
    left_s: float | None


@dataclass(eq=False)
class TrainLoop:
    """A training of one task.

    Attributes:
        task: network and losses, on `device`.
        recipe: recipe of the training.
        order: batches in order.
        device: device of the arithmetic.
        folder: folder of checkpoint and log.
        run: recipe and seed as plain data, for the checkpoint.
        validate: called every `recipe.validate_every` steps.
        show: called after each step.
        average: moving average of the weights: the training's result.
    """

    task: AnyTask
    recipe: TrainingRecipe
    order: SampleOrder | BatchesAhead
    device: torch.device
    folder: Path
    run: Mapping[str, Any]
    validate: Validate | None = None
    show: Callable[[TrainingProgress], object] | None = None
    average: AveragedNet = field(init=False)

    def __post_init__(self) -> None:
        recipe, net = self.recipe, self.task.net
        self.average = AveragedNet(net, recipe.average)
        self._adam = torch.optim.AdamW(_groups(net, recipe), lr=recipe.lr, weight_decay=recipe.weight_decay)
        self._parameters = [each for each in net.parameters() if each.requires_grad]
        self._validation: Mapping[str, float] = {}
        self._position, self._step = Position(), 0

    def train(self) -> None:
        """Train from the folder's checkpoint on, if there is one, up to the recipe's steps.

        Raises:
            InvalidValueError: the folder holds another training.
            TrainingError: the losses are no numbers, or diverge. The last checkpoint is kept.
            KeyboardInterrupt: after a signal to end, once the state is stored.
        """
        found = load_checkpoint(self.folder, self.run, self.task.net, self.average.net, self._adam)
        if found is not None:
            self._step, self._position = found.step, found.position
        log = TrainingLog(self.folder, self._step)
        first, began, saved = self._step, time.monotonic(), time.monotonic()
        watch = LossWatch(f"the weights of step {first} are kept in {self.folder}" if first else "no weights are kept")
        self.task.train()
        with _told_to_end() as end:
            for position, batch in self.order.batches(self._position):
                if self._step >= self.recipe.steps:
                    break
                losses = self._take_step(batch, watch)
                self._position, self._step = position, self._step + 1
                log.add(self._step, losses)
                self._validate(log)
                if self.show is not None:
                    left = (self.recipe.steps - self._step) * (time.monotonic() - began) / (self._step - first)
                    self.show(TrainingProgress(self._step, self.recipe.steps, losses, self._validation, left))
                ending = end.is_set()
                if ending or time.monotonic() - saved > SAVE_EVERY_S:
                    self._save(log)
                    saved = time.monotonic()
                    watch.kept = f"the weights of step {self._step} are kept in {self.folder}"
                if ending:
                    raise KeyboardInterrupt
        self._save(log)

    def _take_step(self, batch: Any, watch: LossWatch) -> dict[str, float]:
        """Take a step of the optimizer. Return the losses before it."""
        rate = one_cycle(self._step, self.recipe.steps, self.recipe.lr)
        for group in self._adam.param_groups:
            group["lr"] = rate * group["factor"]
        short = numbers_on(self.device, self.recipe.precision) is torch.bfloat16
        batch = to_device(batch, self.device)
        self.task.progress = self._step / self.recipe.steps
        with torch.autocast(self.device.type, torch.bfloat16, enabled=short):
            losses: dict[str, Tensor] = self.task(batch)
        if self.recipe.loss:
            losses[LOSS] = sum_of({name: part for name, part in losses.items() if name != LOSS}, self.recipe.loss)
        self._adam.zero_grad()
        losses[LOSS].backward()  # type: ignore[no-untyped-call]
        length = torch.nn.utils.clip_grad_norm_(self._parameters, self.recipe.clip)
        values = {name: float(value.detach()) for name, value in losses.items()}
        watch.check(self._step + 1, values, float(length))
        self._adam.step()
        self.average.update(self.task.net, self._step)
        return values

    def _validate(self, log: TrainingLog) -> None:
        """Validate the averaged network, if it is time to."""
        every = self.recipe.validate_every
        if self.validate is None or not every or (self._step % every and self._step < self.recipe.steps):
            return
        self._validation = self.validate(self.average.net)
        log.add(self._step, self._validation, kind="validation")

    def _save(self, log: TrainingLog) -> None:
        log.write()
        state = Checkpoint(self._step, self._position, self.run)
        save_checkpoint(self.folder, state, self.task.net, self.average.net, self._adam)


def _groups(net: nn.Module, recipe: TrainingRecipe) -> list[dict[str, Any]]:
    """Return AdamW's groups of parameters, one for each factor on the learning rate.

    Raises:
        TrainingError: nothing can be trained, or a factor is for no parameter.
    """
    groups: dict[float, list[nn.Parameter]] = {}
    unused = set(recipe.slower)
    for name, parameter in net.named_parameters():
        starts = [each for each in recipe.slower if name.startswith(each)]
        unused -= set(starts)
        if parameter.requires_grad:
            factor = recipe.slower[max(starts, key=len)] if starts else 1.0
            groups.setdefault(factor, []).append(parameter)
    if unused or not groups:
        raise TrainingError(f"no parameter begins with {sorted(unused)}" if unused else "the network has no parameters")
    return [{"params": each, "factor": factor} for factor, each in sorted(groups.items())]


@contextmanager
def _told_to_end() -> Iterator[threading.Event]:
    """Yield an event that the first Ctrl-C or SIGTERM sets; a second one interrupts at once.

    A step that is interrupted in its middle would leave weights that no uninterrupted training has.
    """
    end = threading.Event()
    if threading.current_thread() is not threading.main_thread():  # only that one has signals
        yield end
        return

    def note(number: int, frame: object) -> None:
        if end.is_set():
            raise KeyboardInterrupt
        end.set()

    usual = {each: signal.signal(each, note) for each in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield end
    finally:
        for each, handler in usual.items():
            signal.signal(each, handler)


class AveragedNet:
    """A copy of a network whose weights follow it slowly: w' <- d w' + (1 - d) w, which evens out small batches' noise.

    The decay d grows from 0.1 as (1 + step) / (10 + step) up to `decay`, so that early averages are not of random
    weights. Counters and other integers are copied.

    Attributes:
        net: the copy, in evaluation mode.
    """

    def __init__(self, net: nn.Module, decay: float) -> None:
        self.net = copy.deepcopy(net).eval().requires_grad_(False)
        self._decay = decay

    @torch.no_grad()
    def update(self, net: nn.Module, step: int) -> None:
        """Follow the network after a step, from 0."""
        share = 1 - min(self._decay, (1 + step) / (10 + step))
        source = net.state_dict()
        for name, value in self.net.state_dict().items():
            if value.is_floating_point():
                value.lerp_(source[name], share)
            else:
                value.copy_(source[name])


def one_cycle(step: int, steps: int, highest: float, rising: float = 0.3) -> float:
    """Return the learning rate of a step: half cosines from highest/25 up to `highest`, and down to highest/10,000.

    Source: Smith and Topin 2019, "Super-convergence", with cosines in place of straight lines.

    Args:
        step: number of the step, from 0.
        steps: steps of the whole training.
        highest: highest learning rate.
        rising: share of the steps in which it rises.
    """
    turn = max(1.0, rising * steps)
    if step < turn:
        return _between(highest / 25, highest, step / turn)
    return _between(highest, highest / 1e4, (step - turn) / max(1.0, steps - 1 - turn))


def _between(first: float, last: float, share: float) -> float:
    return last + (first - last) * 0.5 * (1 + math.cos(math.pi * min(1.0, share)))


class LossWatch:
    """Stop of a training whose losses are not finite, or 50 in a row far above those before.

    Far above is the running median and nine times the median of their magnitudes more: ten times the median of losses
    that are positive. Likelihoods may be of any sign.

    Attributes:
        kept: state of the training that is stored, for the errors.
    """

    def __init__(self, kept: str) -> None:
        self.kept = kept
        self._losses: deque[float] = deque(maxlen=_REMEMBERED)
        self._high = 0

    def check(self, step: int, losses: Mapping[str, float], gradient: float) -> None:
        """Check a step, numbered from 1, before it is taken: losses by name, and the gradient's length.

        Raises:
            TrainingError: a loss or the gradient is not finite, or losses run away.
        """
        broken = [f"{name} is {value}" for name, value in losses.items() if not math.isfinite(value)]
        if not math.isfinite(gradient):
            broken.append(f"the gradient's length is {gradient}")
        if broken:
            raise TrainingError(f"step {step}: {', '.join(broken)}; {self.kept}. A smaller lr or clip may help")
        total = losses["loss"]
        limit = self._limit()
        if total <= limit:
            self._high = 0
            self._losses.append(total)
            return
        self._high += 1
        if self._high >= _PATIENCE:
            raise TrainingError(
                f"step {step}: the loss is {total:.4g}, and since {_PATIENCE} steps above {limit:.4g}, far above its "
                f"median {statistics.median(self._losses):.4g}: it diverges; {self.kept}. A smaller lr may help"
            )

    def _limit(self) -> float:
        """Return the largest accepted loss; infinite while few are known."""
        if len(self._losses) < _LEAST:
            return math.inf
        magnitude = statistics.median(map(abs, self._losses))
        return statistics.median(self._losses) + _TOO_LARGE * magnitude
