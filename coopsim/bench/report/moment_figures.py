"""The worst moments in a report: a policy that falls behind, and the best one at the same time."""

from __future__ import annotations

from coopsim.bench.films.moments import FilmedMoment
from coopsim.bench.grid.labels import label
from coopsim.bench.report.film_data import frame_data, home_of, map_data, run_data
from coopsim.bench.report.film_section import Figure, Panel
from coopsim.bench.report.keys import FALSE_NOTE
from coopsim.bench.report.space_data import pair_view
from coopsim.bench.results.result_table import ResultTable
from coopsim.types import NS_PER_S

NOTE = f"""Windows in which a policy fell farthest behind the best one in the same condition and
seed, varied in policy, condition and traffic. Left the policy, right the best one at the same time. The agent is the
one whose MOTA differs most. {FALSE_NOTE}"""

_SPAN_M = 110


def moment_figure(filmed: FilmedMoment, table: ResultTable) -> Figure:
    """Return a moment as a figure."""
    moment, window = filmed.moment, slice(filmed.moment.first, filmed.moment.last)
    cell, names = moment.worst.cell, [each.cell.policy for each in (moment.worst, moment.best)]
    where = f"{label(cell.condition, table.conditions)}, seed {cell.seed}, tracks of {filmed.agent}"
    means = [each.rewards[window].mean() for each in (moment.worst, moment.best)]
    panels = [Panel(name, f"reward {mean:.2f}") for name, mean in zip(names, means, strict=True)]
    frames = filmed.worst.frames[window]
    home = home_of(frames)
    data = {
        "agent": filmed.agent,
        "start_s": round(frames[0].time_ns / NS_PER_S, 3),
        "dt_s": filmed.worst.dt_s,
        "span": _SPAN_M,
        "map": map_data(filmed.worst.road_map, home),
        "frames": [frame_data(frame, home) for frame in frames],
        "sides": [
            {"runs": [run_data(film, filmed.agent, range(len(film.frames))[window], home)]}
            for film in (filmed.worst, filmed.best)
        ],
    }
    space = pair_view(names, [filmed.worst, filmed.best], filmed.agent, moment.first, moment.last)
    return Figure(f"{names[0]} against {names[1]}: {where}", panels, data, space)
