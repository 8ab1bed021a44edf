"""The cooperative network: from message to fused features."""

from __future__ import annotations

import pytest

torch = pytest.importorskip("torch")
from coopsim.errors import InvalidValueError, UnknownNameError  # noqa: E402
from coopsim.nn.cooperative.cooperative_net import CooperativeConfig, CooperativeNet  # noqa: E402
from coopsim.nn.fusion import FUSIONS, FusionContext  # noqa: E402

torch.set_num_threads(1)
SIZE = (10, 13)
each_fusion = pytest.mark.parametrize("name", FUSIONS.names())


def draw(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(shape, generator=torch.Generator().manual_seed(seed))


def trained(name: str) -> CooperativeNet:
    """Return a network whose weights are all random, also those that start as zeros."""
    net = CooperativeNet.from_config(CooperativeConfig(fusion=name))
    source = torch.Generator().manual_seed(5)
    with torch.no_grad():
        for weights in net.parameters():
            weights.copy_(torch.randn(weights.shape, generator=source) * 0.1)
    return net


def inputs(senders: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor, FusionContext]:
    own_mask = draw(*SIZE, seed=1) < 0.7
    context = FusionContext(torch.zeros(senders), torch.zeros(senders), draw(senders, *SIZE))
    received = draw(senders, 64, *SIZE, seed=2) - 0.5
    return draw(64, *SIZE) * own_mask, own_mask, received, draw(senders, *SIZE, seed=3) < 0.6, context


@each_fusion
def test_without_senders_the_own_map_comes_back(name: str) -> None:
    own, own_mask, received, mask, context = inputs(0)
    assert trained(name)(own, own_mask, received, mask, context) is own


@each_fusion
def test_only_cells_that_others_report_differ(name: str) -> None:
    own, own_mask, received, mask, context = inputs(2)
    out = trained(name)(own, own_mask, received, mask, context)
    seen = mask.any(0)
    assert torch.equal(out[:, ~seen], own[:, ~seen])
    assert (out != own).any(0)[seen].all()


@each_fusion
def test_masked_senders_change_nothing(name: str) -> None:
    own, own_mask, received, mask, context = inputs(2)
    mask[1] = False
    first = FusionContext(context.delay_s[:1], context.kind[:1], context.confidence[:1])
    net = trained(name)
    out = net(own, own_mask, received, mask, context)
    assert torch.allclose(out, net(own, own_mask, received[:1], mask[:1], first), atol=1e-5)


def test_a_message_is_small_and_sure_of_itself_between_0_and_1() -> None:
    values, confidence = trained("attfuse").message(draw(3, 64, *SIZE))
    assert values.shape == (3, 64, *SIZE) and confidence.shape == (3, *SIZE)
    assert values.dtype == torch.float32 and confidence.min() >= 0 and confidence.max() <= 1


@each_fusion
def test_gradients_reach_every_weight(name: str) -> None:
    net = trained(name)
    own, own_mask, _, mask, _ = inputs(2)
    values, confidence = net.message(draw(2, 64, *SIZE, seed=9))
    context = FusionContext(torch.tensor([0.0, 0.3]), torch.zeros(2), confidence)
    net(own, own_mask, values, mask, context).square().sum().backward()
    assert {"compress", "neck"} <= {key.partition(".")[0] for key, _ in net.named_parameters()}
    for part in (net.compress, net.expand, net.fusion, net.neck):
        for key, weights in part.named_parameters():
            assert weights.grad is not None and weights.grad.isfinite().all() and weights.grad.any(), key


@each_fusion
def test_each_file_is_small(name: str) -> None:
    net = CooperativeNet.from_config(CooperativeConfig(fusion=name))
    assert sum(weights.numel() for weights in net.parameters()) <= 450_000


def test_whole_features_arrive_unchanged_before_any_training() -> None:
    net, features = CooperativeNet.from_config(CooperativeConfig()), draw(2, 64, *SIZE)
    values, _ = net.message(features)
    assert torch.equal(values, features)
    assert torch.equal(net.expand(values, torch.tensor([0.0, 0.4])), features)


@pytest.mark.parametrize("name", ["attfuse", "cobevt", "disconet", "gsaf", "v2x_vit", "where2comm"])
def test_a_fusion_may_begin_as_a_choice_of_the_surest(name: str) -> None:
    net = CooperativeNet.from_config(CooperativeConfig(name, surest=100.0)).eval()
    own, others = draw(64, *SIZE), draw(2, 64, *SIZE, seed=7)
    valid, zeros = torch.ones(3, *SIZE, dtype=torch.bool), torch.zeros(2)
    sure = torch.zeros(3, *SIZE)
    sure[1, :, :6], sure[2, :, 6:] = 1.0, 1.0
    context = FusionContext(zeros, zeros, sure[1:], sure[0])
    weights = net.fusion.weights(torch.zeros(3, *SIZE), valid[0], valid[1:], context)
    assert torch.allclose(weights, sure)
    if name in ("attfuse", "disconet", "where2comm"):  # those on patches add what their tokens say
        fused = net(own, valid[0], others, valid[1:], context)
        assert torch.allclose(fused, torch.where(sure[1] > 0, others[0], others[1]), atol=1e-5)


def test_a_network_that_is_told_errors_begins_as_one_that_is_not_and_learns_them() -> None:
    net = CooperativeNet.from_config(CooperativeConfig(told_errors=True))
    values, late = draw(2, 64, *SIZE), torch.zeros(2)
    error_m, range_m = draw(2, *SIZE, seed=4), 60 * draw(2, *SIZE, seed=5)
    assert net.tells_errors and torch.equal(net.expand(values, late, error_m, range_m), net.expand(values, late))
    net.expand(values, late, error_m, range_m).square().sum().backward()
    assert net.expand.placed.weight.grad.any(1).all()  # of each hidden number, and of the gain


def test_old_weights_keep_their_eight_channels() -> None:
    from coopsim.learn.weights import load_cooperative

    net = load_cooperative("gsaf")
    assert net.message_channels == 8 and net.fusion.surest is None and not net.tells_errors


def test_what_is_wrong_is_refused() -> None:
    with pytest.raises(InvalidValueError, match="message_channels must be an integer"):
        CooperativeConfig(message_channels=0)
    with pytest.raises(UnknownNameError, match="attfuse"):
        CooperativeNet.from_config(CooperativeConfig(fusion="atfuse"))
