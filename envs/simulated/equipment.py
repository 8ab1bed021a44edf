"""The sensors that agents of a simulated environment carry."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from coopsim.envs.simulated.simulation_options import SimulationOptions, lidar_carriers
from coopsim.sensors.camera.camera import Rig, agent_rigs
from coopsim.sensors.camera.picture import CameraRig
from coopsim.sensors.camera.renderers import make_renderer
from coopsim.sensors.lidar.lidar import Lidar, LidarConfig, require_above_ground, require_free_mount
from coopsim.sensors.visibility import VisibilityProbe
from coopsim.types import CameraCalibration, CameraImage, LidarMounting
from coopsim.types.sensing import OBSERVED_MODES
from coopsim.world.models.model import Model
from coopsim.world.snapshot import AgentBody, WorldSource


class Equipment:
    """All agents' LiDARs and cameras; one object serves all episodes."""

    def __init__(self, options: SimulationOptions, bodies: Iterable[AgentBody]) -> None:
        self._options = options
        on_ground, in_air = (
            {sensor: Lidar(config, options.chosen_weather) for sensor, config in configs.items()}
            for configs in (options.lidars, options.drone_lidars)
        )
        self.lidars: Mapping[str, Mapping[str, Lidar]] = {"cav": on_ground, "rsu": on_ground, "drone": in_air}
        self.visibility_probes = {
            kind: VisibilityProbe([lidar.config for lidar in lidars.values()]) for kind, lidars in self.lidars.items()
        }
        kinds = {body.name: body.kind for body in bodies}
        self.lidar_carriers = lidar_carriers(options.lidar_agents, kinds) if options.lidars else frozenset[str]()
        self.cameras: Mapping[str, Rig] = agent_rigs(options.cameras, kinds)
        # Where no cameras are on, pictures are those that `cameras=True` would make.
        self._photographers = self.cameras if self.has_cameras else agent_rigs(True, kinds)
        self._rig: CameraRig | None = None

    @property
    def has_cameras(self) -> bool:
        """True if any agent has a camera."""
        return any(self.cameras.values())

    @property
    def images_tell_actors(self) -> bool:
        """True if images have a mode that distinguishes actors."""
        return "instance" in self._options.camera_modes

    @property
    def rig(self) -> CameraRig:
        """The cameras that photograph: the agents' own, or those of `cameras=True` where no agent has any."""
        if self._rig is None:
            self._rig = CameraRig(
                self._photographers,
                make_renderer(self._options.renderer),
                modes=self._options.camera_modes,
                illumination=self._options.illumination,
            )
        return self._rig

    def mountings(self, body: AgentBody) -> dict[str, LidarMounting]:
        """Return the mounting of each LiDAR on an agent, by name."""
        return {sensor: _mounting(lidar.config, body.height_m) for sensor, lidar in self._lidars_of(body).items()}

    def calibrations(self, body: AgentBody) -> dict[str, CameraCalibration]:
        """Return the calibration of each camera on an agent, by name."""
        return {camera.name: camera.calibration(body.height_m) for camera in self.cameras[body.name]}

    def blank_images(self, agent: str) -> dict[str, CameraImage]:
        """Return black images in place of an agent's images, for a frame in which nothing is sensed."""
        modes = [mode for mode in OBSERVED_MODES if mode in self._options.camera_modes]
        return {camera.name: CameraImage.blank(camera.intrinsics.size, modes) for camera in self.cameras[agent]}

    def require_free_mounts(self, world: WorldSource) -> None:
        """Check that no sensor is under the ground or inside the body that carries it.

        Checks every body that may come to carry a sensor: another car is connected in every episode.

        Raises:
            InvalidValueError: names the sensor and where it is.
        """
        actors = world.actors()
        bodies = world.agents().values()
        for body in bodies:
            label = actors.label[actors.id == body.actor_id] if body.actor_id is not None else []
            for shape in (model for model in world.models if model.label in label):
                self._require_free(body, float(shape.size_m[2]), shape)
        self.require_free_masts(bodies)

    def require_free_masts(self, bodies: Iterable[AgentBody]) -> None:
        """Check that no sensor of the agents that are no cars is under the ground; errors as `require_free_mounts`."""
        for body in bodies:
            if body.actor_id is None:
                self._require_free(body, body.height_m, None)

    def _require_free(self, body: AgentBody, height_m: float, shape: Model | None) -> None:
        for sensor, lidar in self._lidars_of(body).items():
            require_free_mount(sensor, lidar.config, height_m, shape)
        for camera in self.cameras[body.name]:  # which its own body does not blind
            require_above_ground(f"camera {camera.name!r} of {body.name}", camera.above_m, height_m)

    def _lidars_of(self, body: AgentBody) -> Mapping[str, Lidar]:
        return self.lidars[body.kind] if body.name in self.lidar_carriers else {}

    def close(self) -> None:
        """Release the renderer's resources."""
        if self._rig is not None:
            self._rig.close()
            self._rig = None


def _mounting(config: LidarConfig, height_m: float) -> LidarMounting:
    """Describe a LiDAR on an agent of this height."""
    pose = config.base_SE3_sensor(height_m)
    return LidarMounting(pose, config.max_range_m, config.columns, config.beams.elevation_rad)
