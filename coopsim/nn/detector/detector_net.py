"""Network of one agent: encoder, centre head (CenterPoint, Yin et al., CVPR 2021) and its code of boxes."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from coopsim.nn.detector.box_judge import BoxJudge, turned_round
from coopsim.nn.detector.encoder import EncoderConfig, PillarEncoder, conv
from coopsim.nn.detector.sparse_cells import SparseCells, SparseConv, filled
from coopsim.nn.detector.sparse_encoder import SparseEncoder
from coopsim.nn.detector.sweep_motion import SweepMotion
from coopsim.types.taxonomy import CLASS_NAMES, ObjectClass

MEAN_SIZE_M = {
    ObjectClass.CAR: (4.6, 1.85, 1.55),
    ObjectClass.VAN: (5.2, 1.95, 2.05),
    ObjectClass.TRUCK: (8.5, 2.47, 3.3),
    ObjectClass.BUS: (11.0, 2.52, 3.25),
    ObjectClass.MOTORCYCLE: (2.05, 0.74, 1.68),
    ObjectClass.BICYCLE: (1.7, 0.55, 1.7),
    ObjectClass.SCOOTER: (1.4, 0.55, 1.75),
    ObjectClass.PEDESTRIAN: (0.85, 0.5, 1.7),
    ObjectClass.CHILD: (0.65, 0.36, 1.22),
}
"""Length, width and height by class, about the means of the models (docs/reference/actors.md): a code says how much
larger a box is, so these need not be exact, but are part of the networks' weights."""

OFFSET, HEIGHT, SIZE = slice(0, 2), slice(2, 3), slice(3, 6)
AXIS, HEADING, VELOCITY = slice(6, 8), slice(8, 10), slice(10, 12)
LOG_VARIANCE = slice(12, 19)
CODE = 19
"""All numbers of a predicted code."""

VELOCITY_SCALE = 10.0
"""Velocities in codes are in so many m/s."""


def size_priors(device: torch.device | str = "cpu") -> Tensor:
    """Return the sizes (9, 3) m that codes are relative to, by label."""
    return torch.tensor([MEAN_SIZE_M[cls] for cls in ObjectClass], dtype=torch.float32, device=device)


def encode_boxes(boxes: Tensor, velocity: Tensor, label: Tensor, center_m: Tensor, cell_m: float) -> Tensor:
    """Return the codes of boxes seen from cells.

    | numbers | meaning |
    |---|---|
    | 0, 1 | offset of the box's centre from the cell's, in cells |
    | 2 | z of the box's centre, m |
    | 3-5 | log of length, width and height over the class's usual ones |
    | 6, 7 | cos and sin of twice the yaw: the axis, which is seen even where front and rear look alike |
    | 8, 9 | cos and sin of the yaw: which way along the axis |
    | 10, 11 | velocity over ground, in 10 m/s |

    Args:
        boxes: (N, 7) x, y, z, l, w, h, yaw.
        velocity: (N, 2) m/s.
        label: (N,) int64.
        center_m: (N, 2) centres of the cells.
        cell_m: their edge.

    Returns:
        (N, 12) float32.
    """
    yaw = boxes[:, 6:7]
    size = torch.log(boxes[:, 3:6] / size_priors(boxes.device)[label])
    turned = [torch.cos(2 * yaw), torch.sin(2 * yaw), torch.cos(yaw), torch.sin(yaw)]
    offset = (boxes[:, :2] - center_m) / cell_m
    return torch.cat([offset, boxes[:, 2:3], size, *turned, velocity / VELOCITY_SCALE], dim=1).float()


def decode_boxes(code: Tensor, label: Tensor, center_m: Tensor, cell_m: float) -> tuple[Tensor, Tensor]:
    """Return boxes (N, 7) and velocities (N, 2) m/s of codes (N, >= 12): the inverse of `encode_boxes`.

    The yaw is the axis, in that of its two directions which is nearer to the predicted one: a box cannot flip because
    the prediction of its axis wavers.
    """
    axis = 0.5 * torch.atan2(code[:, 7], code[:, 6])
    ahead = torch.cos(axis) * code[:, 8] + torch.sin(axis) * code[:, 9]
    yaw = torch.where(ahead >= 0, axis, axis + torch.pi)
    yaw = torch.atan2(torch.sin(yaw), torch.cos(yaw))
    size = size_priors(code.device)[label] * torch.exp(code[:, SIZE].clamp(-1.5, 1.5))
    boxes = torch.cat([center_m + code[:, OFFSET] * cell_m, code[:, HEIGHT], size, yaw[:, None]], dim=1)
    return boxes, code[:, VELOCITY] * VELOCITY_SCALE


def residuals(code: Tensor, target: Tensor, yaw: Tensor, cell_m: float) -> Tensor:
    """Return the errors (N, 7) that log variances describe.

    They are along and across the box (m), of its height z (m), of the logs of its sizes, and of its yaw (rad, modulo
    half a turn).

    Args:
        code: predicted, (N, >= 12).
        target: true, (N, 12).
        yaw: (N,) of the true boxes.
        cell_m: edge of a cell.
    """
    error = (code[:, OFFSET] - target[:, OFFSET]) * cell_m
    cos, sin = torch.cos(yaw), torch.sin(yaw)
    along, across = error[:, 0] * cos + error[:, 1] * sin, error[:, 1] * cos - error[:, 0] * sin
    turned = torch.atan2(code[:, 7], code[:, 6]) - torch.atan2(target[:, 7], target[:, 6])
    turned = 0.5 * torch.atan2(torch.sin(turned), torch.cos(turned))
    rest = code[:, 2:6] - target[:, 2:6]
    return torch.cat([along[:, None], across[:, None], rest, turned[:, None]], dim=1)


def covariances(log_variance: Tensor, boxes: Tensor) -> Tensor:
    """Return covariances (N, 7, 7) of x, y, z, l, w, h, yaw, from the log variances (N, 7) of `residuals`.

    Variances along and across are turned with the decoded boxes (N, 7), those of logs of sizes become metres.
    """
    variance = torch.exp(log_variance.double().clamp(-8.0, 4.0))
    cos, sin = torch.cos(boxes[:, 6]).double(), torch.sin(boxes[:, 6]).double()
    along, across = variance[:, 0], variance[:, 1]
    out = torch.diag_embed(torch.cat([variance[:, :3], variance[:, 3:6] * boxes[:, 3:6].double() ** 2,
                                      variance[:, 6:]], dim=1))  # fmt: skip
    out[:, 0, 0] = along * cos**2 + across * sin**2
    out[:, 1, 1] = along * sin**2 + across * cos**2
    out[:, 0, 1] = out[:, 1, 0] = (along - across) * sin * cos
    return out


VEHICLES = 0
"""Number of the group of vehicles among those of `coopsim.nn.detector.decode.GROUPS`."""

RARE = -math.log((1 - 0.02) / 0.02)
"""Bias of the heat: most cells are no centre."""

NOTHING = -20.0
"""Logit of the heat where there are no features."""


class CentreHead(nn.Module):
    """Heat of each class in each cell, and a code of the box (see `box_code`) for selected cells.

    Codes are computed only where a centre is or may be: that is nearly free.

    Args:
        channels: channels of the features.
        classes: number of classes.
        turned: the head looks again at each of its boxes, for which end is the front. The code of one cell does not
            show that: front and back look alike to it unless they lie as in most of the training.
    """

    def __init__(self, channels: int = 64, classes: int = len(CLASS_NAMES), *, turned: bool = False) -> None:
        super().__init__()
        self.channels = channels
        self.shared = conv(channels, channels)
        self.heat_of = nn.Conv2d(channels, classes, 1)
        nn.init.constant_(self.heat_of.bias, RARE)  # type: ignore[arg-type]
        self.code_of = nn.Sequential(nn.Linear(channels, channels), nn.ReLU(), nn.Linear(channels, CODE))
        self.judge = BoxJudge(channels, fits=False) if turned else None

    def heat(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return shared features (B, C, h, w), and logits of the heat (B, 9, h, w), of features (B, C, h, w)."""
        shared = self.shared(features)
        return shared, self.heat_of(shared).float()

    def codes(self, shared_at: Tensor) -> Tensor:
        """Return the codes (N, 19) of N cells from their shared features (N, C), in float32."""
        with torch.autocast(shared_at.device.type, enabled=False):
            code: Tensor = self.code_of(shared_at.float())
        return code

    def second_look(self, boxes: Tensor, score: Tensor, group: Tensor, patches: Tensor) -> tuple[Tensor, Tensor]:
        """Return boxes (N, 7), vehicles the right way round, and their scores (N,); see `JudgedHead.second_look`.

        The sweep of a person does not show which way they face, so people and riders stay as they are.
        """
        assert self.judge is not None
        forward, _ = self.judge(patches)
        return turned_round(boxes, torch.where(group == VEHICLES, forward, 1.0)), score


def at_cells(maps: Tensor, cell: Tensor) -> Tensor:
    """Return the features (N, C) of cells (N,), numbered through a batch of maps (B, C, h, w)."""
    batch, channels, rows, columns = maps.shape
    return maps.permute(0, 2, 3, 1).reshape(batch * rows * columns, channels)[cell]


class JudgedHead(nn.Module):
    """Heat and codes as `CentreHead` has them, computed where features are, and a second look at each box.

    Args:
        channels: channels of the features.
        classes: number of classes.
    """

    def __init__(self, channels: int = 64, classes: int = len(CLASS_NAMES)) -> None:
        super().__init__()
        self.channels = channels
        self.shared = SparseConv(channels, channels)
        self.heat_of = nn.Linear(channels, classes)
        nn.init.constant_(self.heat_of.bias, RARE)
        self.code_of = nn.Sequential(nn.Linear(channels, 2 * channels), nn.ReLU(), nn.Linear(2 * channels, CODE))
        self.judge = BoxJudge(channels)
        self.register_buffer("calibration", torch.tensor([[1.0, 0.0]] * 3))

    def heat(self, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return shared features and logits, as `CentreHead.heat` does; where features are zero, nothing is found."""
        cells = SparseCells.of(filled(features))
        rows = features.permute(0, 2, 3, 1).flatten(0, 2)[cells.cell]
        shared = self.shared(rows, cells.neighbors())
        logits = self.heat_of(shared).float()
        return cells.dense(shared), cells.dense(logits, NOTHING)

    def codes(self, shared_at: Tensor) -> Tensor:
        """Return the codes (N, 19) of N cells from their shared features (N, C), in float32."""
        with torch.autocast(shared_at.device.type, enabled=False):
            code: Tensor = self.code_of(shared_at.float())
        return code

    def uncalibrate(self) -> None:
        """Let scores be as the network gives them."""
        self.get_buffer("calibration").copy_(torch.tensor([[1.0, 0.0]] * 3))

    def second_look(self, boxes: Tensor, score: Tensor, group: Tensor, patches: Tensor) -> tuple[Tensor, Tensor]:
        """Return boxes (N, 7) the right way round, and calibrated scores (N,).

        The score is the root of heat times quality (CenterPoint, section 4.2), its logit moved and stretched for each
        group so that it is the share of right boxes among those with this score.

        Args:
            boxes: found boxes.
            score: (N,) heat.
            group: (N,) number of the class's group.
            patches: (N, 9 C), see `coopsim.nn.covariance.covariance_net.box_patches`.
        """
        forward, fits = self.judge(patches)
        assert fits is not None
        logit = torch.logit(torch.sqrt(score * fits.sigmoid()), 1e-6)
        slope, shift = self.get_buffer("calibration")[group].unbind(1)
        return turned_round(boxes, forward), torch.sigmoid(slope * logit + shift)


def make_head(kind: str, channels: int) -> CentreHead | JudgedHead:
    """Return a head of one of `HEADS` with random weights."""
    return JudgedHead(channels) if kind in ("judged", "street") else CentreHead(channels, turned=kind == "turned")


def make_encoder(config: EncoderConfig) -> PillarEncoder | SparseEncoder:
    """Return an encoder of points with random weights."""
    return SparseEncoder(config) if config.layout == "sparse" else PillarEncoder(config)


class DetectorNet(nn.Module):
    """An encoder of points, the head on its features, and perhaps the motion of boxes; state: `encoder.*`, `head.*`,
    `motion.*`.
    """

    def __init__(self, config: EncoderConfig | None = None) -> None:
        super().__init__()
        self.config = config or EncoderConfig()
        self.encoder = make_encoder(self.config)
        self.head = make_head(self.config.head, self.config.features)
        self.motion = SweepMotion() if self.config.tells_motion else None
