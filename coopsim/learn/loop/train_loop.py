"""The loop of a training: steps of the optimizer, and what is done between them."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from coopsim.errors import TrainingError
from coopsim.learn.loop.averaged_net import AveragedNet
from coopsim.learn.loop.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from coopsim.learn.loop.loss_watch import LossWatch
from coopsim.learn.loop.one_cycle import one_cycle
from coopsim.learn.loop.ranks import Ranks
from coopsim.learn.loop.training_log import TrainingLog
from coopsim.learn.losses.losses import sum_of
from coopsim.learn.recipe import TrainingRecipe
from coopsim.learn.samples.sample_order import Position, SampleOrder
from coopsim.learn.tasks.training_task import LOSS, TrainingTask
from coopsim.nn.inference.devices import numbers_on, to_device

SAVE_EVERY_S = 60.0
"""Time between two checkpoints."""

Validate = Callable[[nn.Module], Mapping[str, float]]
"""Looks at the averaged network; returns values by name, as "AP"."""


@dataclass(frozen=True, slots=True)
class TrainingProgress:
    """How far a training is.

    Attributes:
        step: number of steps taken, those before an interruption included.
        steps: of the whole training.
        losses: of the last step, by name.
        validation: the last values of held-out places, by name; empty before the first.
        left_s: time that is left; None: not known yet.
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
        task: network and losses, on the device of `ranks`.
        recipe: of the training.
        order: of the samples.
        ranks: processes that train together.
        folder: of checkpoint and log.
        run: all that decides the training, for the checkpoint.
        validate: looks at held-out places every `recipe.validate_every` steps.
        show: called after each step.
        average: moving average of the weights: the training's result.
    """

    task: TrainingTask
    recipe: TrainingRecipe
    order: SampleOrder
    ranks: Ranks
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
            self._step, self._position = found.step, found.positions[self.ranks.rank]
        log = TrainingLog(self.folder, self._step, writes=self.ranks.writes)
        first, began, saved = self._step, time.monotonic(), time.monotonic()
        watch = LossWatch(f"the weights of step {first} are kept in {self.folder}" if first else "no weights are kept")
        model = self.ranks.wrap(self.task)
        self.task.train()
        with _told_to_end() as end:
            for position, samples in self.order.batches(self._position):
                if self._step >= self.recipe.steps:
                    break
                losses = self._take_step(model, samples, watch)
                self._position, self._step = position, self._step + 1
                log.add(self._step, losses)
                self._look(log)
                if self.show is not None:
                    left = (self.recipe.steps - self._step) * (time.monotonic() - began) / (self._step - first)
                    self.show(TrainingProgress(self._step, self.recipe.steps, losses, self._validation, left))
                ending = self.ranks.any(end.is_set())
                if ending or self.ranks.any(time.monotonic() - saved > SAVE_EVERY_S):
                    self._save(log)
                    saved = time.monotonic()
                    watch.kept = f"the weights of step {self._step} are kept in {self.folder}"
                if ending:
                    raise KeyboardInterrupt
        self._save(log)

    def _take_step(self, model: Any, samples: list[Any], watch: LossWatch) -> dict[str, float]:
        """Take a step of the optimizer. Return the losses before it."""
        rate = one_cycle(self._step, self.recipe.steps, self.recipe.lr)
        for group in self._adam.param_groups:
            group["lr"] = rate * group["factor"]
        device = self.ranks.device
        short = numbers_on(device, self.recipe.precision) is torch.bfloat16
        batch = to_device(self.task.collate(samples), device)
        self.task.progress = self._step / self.recipe.steps
        with torch.autocast(device.type, torch.bfloat16, enabled=short):
            losses: dict[str, Tensor] = model(batch)
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

    def _look(self, log: TrainingLog) -> None:
        """Look at held-out places, if it is time to."""
        every = self.recipe.validate_every
        if self.validate is None or not every or (self._step % every and self._step < self.recipe.steps):
            return
        if self.ranks.writes:
            self._validation = self.validate(self.average.net)
            log.add(self._step, self._validation, kind="validation")

    def _save(self, log: TrainingLog) -> None:
        positions = self.ranks.positions(self._position)
        if self.ranks.writes:
            log.write()
            state = Checkpoint(self._step, positions, self.run)
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
