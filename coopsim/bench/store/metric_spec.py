"""Sources of the metrics that users and packages register, with which other processes register them."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass

from coopsim.errors import InvalidValueError
from coopsim.metrics.built_in import BUILT_IN, custom_metrics
from coopsim.metrics.metric import METRICS
from coopsim.support.user_code import SOURCE, load_source


@dataclass(frozen=True, slots=True)
class MetricSpec:
    """Source of a metric that a user or a package registered.

    Attributes:
        name: registered name.
        module: name of the module that registers it.
        path: path of the module's file, if it is not importable because it came with a policy (`file.py:Class`).
        source: text of that file; None for an importable module.
    """

    name: str
    module: str
    path: str | None = None
    source: str | None = None

    @classmethod
    def all(cls) -> tuple[MetricSpec, ...]:
        """Describe every registered metric that is not built in.

        Raises:
            InvalidValueError: a script itself registers a metric, which other processes cannot import.
        """
        specs = []
        for name, metric in custom_metrics().items():
            module = type(metric).__module__
            if module == "__main__":
                raise InvalidValueError(
                    f"metric {name!r} must be registered in a module, or in the file of a policy, for a benchmark's "
                    "processes to load it; it is registered in the script that runs"
                )
            content = vars(sys.modules[module])
            source = content.get(SOURCE)
            specs.append(cls(name, module, None if source is None else str(content["__file__"]), source))
        return tuple(specs)

    def load(self) -> None:
        """Register the metric in this process. Raises `InvalidValueError` if its module does not."""
        if self.name not in METRICS:
            if self.source is not None and self.path is not None:
                load_source(self.path, self.source)
            else:
                importlib.import_module(self.module)
        if self.name not in METRICS:
            raise InvalidValueError(f"metric {self.name!r} is not registered by the module {self.module!r}")


def keep_named(values: Mapping[str, float], metrics: tuple[MetricSpec, ...]) -> dict[str, float]:
    """Drop the values of registered metrics that are not among `metrics`, as another job may have registered them."""
    named = {spec.name for spec in metrics}
    return {name: value for name, value in values.items() if name in BUILT_IN or name in named}
