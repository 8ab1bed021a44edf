"""The encoder of pictures: to the same kind of map of features that the encoder of points makes."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.depth_bins import DepthBins
from coopsim.nn.camera.picture_batch import PictureBatch
from coopsim.nn.camera.picture_net import BACKBONES, PictureFeatures, PictureNet
from coopsim.nn.camera.splat import EXTRA, Canvas
from coopsim.nn.detector.encoder import COARSEST, MOST_CHANNELS, EncoderConfig, MapEncoder
from coopsim.support.checks import require_choice, require_count


@dataclass(frozen=True, slots=True)
class LiftSplatConfig:
    """Sizes of an encoder of pictures. Those of its maps are as in `EncoderConfig`.

    Attributes:
        backbone: name in `coopsim.nn.camera.picture_net.BACKBONES`.
        width: channels of its map.
        picture_features: numbers of a picture's cell that are laid on the canvas.
        depth_bins: number of bins.
        farthest_m: depth from which nothing is laid.
        cell_m: edge of a cell of the canvas.
        channels: of the three scales.
        layers: of the three scales.
        features: of the result.
    """

    backbone: str = "small"
    width: int = 64
    picture_features: int = 30
    depth_bins: int = 64
    farthest_m: float = 60.0
    cell_m: float = 0.6
    channels: tuple[int, int, int] = (48, 64, 96)
    layers: tuple[int, int, int] = (2, 3, 3)
    features: int = 64

    def __post_init__(self) -> None:
        require_choice("backbone", self.backbone, BACKBONES.names())
        require_count(1, MOST_CHANNELS, width=self.width, picture_features=self.picture_features)
        DepthBins(farthest_m=self.farthest_m, count=self.depth_bins)  # its own checks
        maps = self.maps
        for name in ("cell_m", "channels", "layers", "features"):
            object.__setattr__(self, name, getattr(maps, name))

    @property
    def bins(self) -> DepthBins:
        """The bins of depth."""
        return DepthBins(farthest_m=self.farthest_m, count=self.depth_bins)

    @property
    def maps(self) -> EncoderConfig:
        """The sizes of the part that works on canvases, and of the head."""
        return EncoderConfig(self.cell_m, self.picture_features + EXTRA, self.channels, self.layers, self.features)


class PictureCanvas(nn.Module):
    """A network on pictures, and the canvases on which its features are laid.

    Args:
        config: its sizes.
    """

    def __init__(self, config: LiftSplatConfig) -> None:
        super().__init__()
        self.config = config
        self.net = PictureNet(config.picture_features, config.bins, config.backbone, config.width)
        self.register_buffer("middles_m", config.bins.middles(), persistent=False)

    def look(self, batch: PictureBatch) -> list[PictureFeatures]:
        """Return what is seen in each group of pictures."""
        return [self.net(views.rgb, views.geometry) for views in batch.views]

    def canvas(self, batch: PictureBatch, seen: list[PictureFeatures]) -> Tensor:
        """Return what was seen, laid on the agents' canvases, (A, picture_features + 2, H, W).

        Raises:
            InvalidValueError: rows or columns of the canvas do not divide by 8.
        """
        if any(cells % COARSEST for cells in batch.shape):
            raise InvalidValueError(f"rows and columns of a canvas must divide by {COARSEST}, got {batch.shape}")
        middles_m = self.get_buffer("middles_m")
        canvas = Canvas(batch.agents, batch.shape, self.config.picture_features, middles_m)
        for views, each in zip(batch.views, seen, strict=True):
            alpha = each.depth.float().softmax(1)[:, :-1]
            canvas.lay(views, each.features.float(), alpha, middles_m)
        return canvas.painted()


class LiftSplatEncoder(MapEncoder):
    """A network on pictures, whose features are laid on a canvas, and the three scales of the encoder of points.

    Args:
        config: its sizes.
    """

    def __init__(self, config: LiftSplatConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or LiftSplatConfig()
        self.pictures = PictureCanvas(config)
        self.make_scales(config.maps)
        self.to(memory_format=torch.channels_last)  # type: ignore[call-overload]

    def forward(self, batch: PictureBatch) -> Tensor:
        """Return features (A, C, H / 2, W / 2), not negative.

        Raises:
            InvalidValueError: rows or columns of the canvas do not divide by 8.
        """
        return self.of_canvas(self.pictures.canvas(batch, self.pictures.look(batch)))
