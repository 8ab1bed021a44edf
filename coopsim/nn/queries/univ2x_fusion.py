"""UniV2X's cooperation of instances (Yu et al., AAAI 2025): matched by distance and added, before they are decoded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor, nn

from coopsim.nn.queries.cooptrack_fusion import ComparedInstances, ReceivedInstances, aligned_boxes
from coopsim.nn.queries.instance_fusion import InstanceFold, pairs_by_gate
from coopsim.nn.queries.instances import Instances

_LEAST_SCORE = 0.05


class UniV2XFusion(nn.Module):
    """Fuse instances of any number of senders into queries that are not decoded yet.

    A sender's feature f becomes f' = Linear([f ; R]), with the nine numbers of the rotation R between the frames, and a
    pair's query q + Linear(f').
    """

    before_decoding = True

    def __init__(self, width: int) -> None:
        super().__init__()
        self.align, self.add = nn.Linear(width + 9, width), nn.Linear(width, width)

    def forward(
        self, own: Instances, received: Sequence[ReceivedInstances], least: float, most: int, *, by_rule: bool = False
    ) -> tuple[Instances, list[ComparedInstances]]:
        """Return the fused instances, and nothing compared: no association is learned.

        Arguments as of `CoopTrackFusion.forward`, `own` with queries as its semantics. No pair is made if `least` is
        above 1; `by_rule` has no effect.
        """
        fold = InstanceFold(own)
        for each in received:
            others = aligned_boxes(each.instances, each.receiver_SE3_sender, each.delay_s)
            others = replace(others, semantic=self._aligned(each))
            pairs = pairs_by_gate(fold.known, others, _LEAST_SCORE if least <= 1 else torch.inf)
            columns = torch.from_numpy(pairs[1]).to(others.box.device)
            added = self.add(others.semantic[columns])
            fold.add(others, pairs, each.delay_s, (added, torch.zeros_like(added)), None)
        return fold.instances(most), []

    def _aligned(self, received: ReceivedInstances) -> Tensor:
        given = received.instances.semantic
        rotation = given.new_tensor(received.receiver_SE3_sender.rotation.ravel().tolist())
        aligned: Tensor = self.align(torch.cat([given, rotation.expand(len(given), -1)], dim=1))
        return aligned
