"""Encoder of pictures: features, spread along their lines of sight and gathered in cells seen from above.

Philion and Fidler, "Lift, Splat, Shoot: Encoding Images from Arbitrary Camera Rigs by Implicitly Unprojecting to 3D",
ECCV 2020, section 3: a pixel with feature c and probabilities alpha of depths d_k has the feature alpha_k c at d_k.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from coopsim.errors import InvalidValueError
from coopsim.nn.camera.picture_batch import CameraViews, PictureBatch
from coopsim.nn.camera.picture_net import BACKBONES, DepthBins, PictureFeatures, PictureNet
from coopsim.nn.detector.detector_net import CentreHead
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
        channels: channels of the three scales.
        layers: layers of the three scales.
        features: channels of the result.
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
    """A network on pictures, and the canvases on which its features are laid."""

    def __init__(self, config: LiftSplatConfig) -> None:
        super().__init__()
        self.config = config
        self.net = PictureNet(config.picture_features, config.bins, config.backbone, config.width)
        self.register_buffer("middles_m", config.bins.middles(), persistent=False)

    def read(self, batch: PictureBatch) -> list[PictureFeatures]:
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
    """A network on pictures, whose features are laid on a canvas, and the three scales of the encoder of points."""

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
        return self.of_canvas(self.pictures.canvas(batch, self.pictures.read(batch)))


EXTRA = 2
"""Numbers of a cell of a canvas besides the features: how much was laid there, and how high."""

_LEAST = 1 / 200
"""Smaller probabilities are left out: most of all, which together are a few hundredths."""

_HALF = 0.3
"""Probability in a cell for which its features count about half."""


class Canvas:
    """Sums of picture features in the cells of A canvases; `like` is a tensor with their device and numbers."""

    def __init__(self, agents: int, shape: tuple[int, int], features: int, like: Tensor) -> None:
        self._agents, self._shape = agents, shape
        self._sums = like.new_zeros(agents * shape[0] * shape[1], features + EXTRA)

    def lay(self, views: CameraViews, features: Tensor, alpha: Tensor, depths_m: Tensor) -> None:
        """Lay pictures out.

        Args:
            views: M pictures.
            features: (M, C, h, w).
            alpha: (M, K, h, w) probabilities of depths; the rest to 1 is nowhere.
            depths_m: (K,).
        """
        rows, columns = self._shape
        kept = alpha.detach() > _LEAST
        picture, bin_of, i, j = kept.nonzero(as_tuple=True)
        depth = depths_m[bin_of]
        place = views.start[picture] + depth[:, None] * views.ray.permute(0, 2, 3, 1)[picture, i, j]
        column, row = place[:, 0].floor().long(), place[:, 1].floor().long()
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        picture, bin_of, i, j = picture[inside], bin_of[inside], i[inside], j[inside]
        cell = (views.agent[picture] * rows + row[inside]) * columns + column[inside]
        share = alpha[picture, bin_of, i, j][:, None]
        height = 0.25 * place[inside, 2:].clamp(-4.0, 12.0)
        laid = torch.cat([share * features.permute(0, 2, 3, 1)[picture, i, j], share, share * height], 1)
        self._sums = self._sums.index_add(0, cell, laid)

    def painted(self) -> Tensor:
        """Return the canvases (A, C + 2, H, W): means that are weaker where little was laid, zero where nothing was."""
        sums = self._sums
        features, share, height = sums[:, :-EXTRA], sums[:, -2:-1], sums[:, -1:]
        weak = 1 / (share + _HALF)
        flat = torch.cat([features * weak, torch.log1p(share), height * weak], 1)
        return flat.view(self._agents, *self._shape, -1).permute(0, 3, 1, 2)


class PictureDetectorNet(nn.Module):
    """An encoder of pictures and the head on its features; state: `encoder.*`, `head.*`."""

    def __init__(self, config: LiftSplatConfig | None = None) -> None:
        super().__init__()
        self.config = config or LiftSplatConfig()
        self.encoder = LiftSplatEncoder(self.config)
        self.head = CentreHead(self.config.features)
