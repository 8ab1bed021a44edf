"""Small logs of every format, written by hand."""

from __future__ import annotations

import gzip
import pickle
from pathlib import Path
from typing import Any

import numpy as np

TABLE = """time_s,id,class,x_m,y_m,heading_rad,length_m,width_m,height_m
0.0,a,car,0.0,0.0,0.0,4.2,1.8,1.5
0.1,a,car,1.0,0.0,0.0,4.2,1.8,1.5
0.2,a,car,2.0,0.0,0.0,4.2,1.8,1.5
0.3,a,car,3.0,0.0,0.0,4.2,1.8,1.5
0.1,walker,pedestrian,5.0,5.0,1.5,0.5,0.6,1.8
0.2,walker,pedestrian,5.0,5.1,1.5,0.5,0.6,1.8
"""

FLOATING = """<fcd-export>
  <timestep time="10.00">
    <vehicle id="x" x="10.00" y="0.00" angle="90.00" type="passenger" speed="10.00" pos="1" lane="e_0" slope="0"/>
    <vehicle id="b" x="0.00" y="50.00" angle="0.00" type="city_bus" speed="0.00" pos="1" lane="e_0" slope="0"/>
    <person id="p" x="3.00" y="4.00" angle="180.00" speed="1.00" pos="1" edge="e" slope="0"/>
  </timestep>
  <timestep time="10.10">
    <vehicle id="x" x="11.00" y="0.00" angle="90.00" type="passenger" speed="10.00" pos="2" lane="e_0" slope="0"/>
  </timestep>
</fcd-export>
"""

INTERACTION = """case_id,track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width
1,1,1,100,car,0,0,5,0,0,4,2
1,1,2,200,car,0.5,0,5,0,0,4,2
1,P1,1,100,pedestrian/bicycle,9,9,4,0,,,
1,P1,2,200,pedestrian/bicycle,9.4,9,4,0,,,
1,P2,1,100,pedestrian/bicycle,19,9,1,0,,,
1,P2,2,200,pedestrian/bicycle,19.1,9,1,0,,,
2,1,1,100,car,70,0,5,0,0,4,2
"""

IND = {
    "tracks": """recordingId,trackId,frame,xCenter,yCenter,heading,width,length,xVelocity,yVelocity
7,0,25,10.0,-5.0,90.0,1.8,4.4,0.0,8.0
7,0,26,10.0,-4.68,90.0,1.8,4.4,0.0,8.0
7,1,25,3.0,3.0,0.0,0.0,0.0,1.0,0.0
7,1,26,3.04,3.0,0.0,0.0,0.0,1.0,0.0
""",
    "tracksMeta": "recordingId,trackId,class\n7,0,truck_bus\n7,1,pedestrian\n",
    "recordingMeta": "recordingId,frameRate\n7,25.0\n",
}

HIGHD = {
    "tracks": """frame,id,x,y,width,height,xVelocity,yVelocity
1,1,100.0,20.0,4.0,2.0,-30.0,0.5
2,1,98.8,20.02,4.0,2.0,-30.0,0.5
""",
    "tracksMeta": "id,class,drivingDirection\n1,Car,1\n",
    "recordingMeta": "id,frameRate\n1,25\n",
}


def write_level_x(folder: Path, parts: dict[str, str]) -> Path:
    """Write the three files of a recording, and return the first."""
    for name, text in parts.items():
        (folder / f"07_{name}.csv").write_text(text)
    return folder / "07_tracks.csv"


def forecast_columns() -> dict[str, list[Any]]:
    """Return the columns of a scenario of Argoverse 2."""
    return {
        "track_id": ["AV", "AV", "9", "9"],
        "timestep": [0, 1, 0, 1],
        "object_type": ["vehicle", "vehicle", "static", "static"],
        "position_x": [0.0, 1.0, 5.0, 5.0],
        "position_y": [0.0, 0.0, 5.0, 5.0],
        "heading": [0.0, 0.0, 0.0, 0.0],
        "velocity_x": [10.0, 10.0, 0.0, 0.0],
        "velocity_y": [0.0, 0.0, 0.0, 0.0],
    }


def write_parquet(path: Path, columns: dict[str, Any]) -> Path:
    """Write a table."""
    import pyarrow as pa
    from pyarrow import parquet

    parquet.write_table(pa.table(columns), path)
    return path


def scenario() -> dict[str, Any]:
    """Return a scenario of ScenarioNet: a car that is lost for one step, and a cone."""
    times = np.arange(4) / 10
    state = {
        "position": np.column_stack([10 * times, 0 * times, np.full(4, 100.75)]),
        "heading": np.zeros(4, np.float32),
        "velocity": np.tile([10.0, 0.0], (4, 1)),
        "valid": np.array([1, 1, 0, 1], bool),
        "length": np.full(4, 4.4),
        "width": np.full(4, 1.9),
        "height": np.full((4, 1), 1.5),
    }
    tracks = {"17": {"type": "VEHICLE", "state": state}, "18": {"type": "TRAFFIC_CONE", "state": state}}
    return {"id": "s", "tracks": tracks, "metadata": {"ts": times, "sdc_id": "17"}}


def write_pickle(path: Path, content: Any, protocol: int = 4) -> Path:
    """Write a pickle."""
    path.write_bytes(pickle.dumps(content, protocol))
    return path


def write_gzip(path: Path, text: str) -> Path:
    """Write a text in gzip."""
    path.write_bytes(gzip.compress(text.encode()))
    return path
