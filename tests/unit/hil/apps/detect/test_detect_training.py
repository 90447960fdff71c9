"""Training learns, repeats itself bit by bit, goes on where it was stopped, and leaves files that three libraries run.

Needs PyTorch, which nothing else of the suite does.
"""

from __future__ import annotations

import random
import resource
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

torch = pytest.importorskip("torch")

from rich.console import Console  # noqa: E402

from hil.apps.detect.command import TrainingData, train_detector  # noqa: E402
from hil.apps.detect.pictures import Picture, read_data_sets  # noqa: E402
from hil.config.companion.clients import make_client_importable  # noqa: E402
from signals.errors import ConfigError, RecordingError  # noqa: E402
from tests.worlds.labelled_pictures import some_objects, write_data_set  # noqa: E402

make_client_importable()
from hil_companion.detect import decode as numpy_decode  # noqa: E402
from hil_companion.detect.backends import BACKENDS  # noqa: E402
from hil_companion.detect.detector import Detector  # noqa: E402
from hil_companion.detect.model_file import by_anchor as numpy_by_anchor  # noqa: E402

from hil.apps.detect.training import batches, train  # noqa: E402
from hil.apps.detect.training.assign import BACKGROUND, ignored  # noqa: E402
from hil.apps.detect.training.batches import COMMON_SHARE, Batches, repeat_factors  # noqa: E402
from hil.apps.detect.training.export import export, folded, with_threshold  # noqa: E402
from hil.apps.detect.training.layout import INPUT_PX, LEVELS, describe  # noqa: E402
from hil.apps.detect.training.loss import QualityFocal, boxes_px, detection_loss, overlaps  # noqa: E402
from hil.apps.detect.training.model import SsdLite, Widths, by_anchor, new_blocks  # noqa: E402
from hil.apps.detect.training.start_weights import normalisation_renamed, read_start_weights, set_statistics  # noqa: E402

QUICK: dict[str, Any] = {"epochs": 2, "batch": 2, "min_objects": 1, "threads": 1, "validate_every": 2}


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> list[Picture]:
    rng = np.random.default_rng(2)
    frames = [some_objects(rng) for _ in range(4)]
    return read_data_sets([write_data_set(tmp_path_factory.mktemp("data") / "set", frames)])


def _run(training: train.Training) -> list[train.Epoch]:
    epochs: list[train.Epoch] = []
    training.run(on_step=lambda *_: None, on_epoch=epochs.append)
    return epochs


def test_a_damaged_checkpoint_is_told(pictures: list[Picture], tmp_path: Path) -> None:
    """PyTorch reads a checkpoint with a flipped bit as one with other weights."""
    training = train.Training(pictures, [], train.Settings(**{**QUICK, "epochs": 1}), out=tmp_path)
    _run(training)
    path, numbers = tmp_path / train.CHECKPOINT, random.Random(1)
    whole = path.read_bytes()
    digest, told = training.weights_digest(), 0
    for _ in range(12):
        data = bytearray(whole)
        data[numbers.randrange(len(data))] ^= 1 << numbers.randrange(8)
        path.write_bytes(data)
        try:
            assert training.resume()
        except ConfigError:
            told += 1
        assert training.weights_digest() == digest
    assert told > 6
    for damaged in (b"", whole[: len(whole) // 2]):
        path.write_bytes(damaged)
        with pytest.raises(ConfigError, match=r"last\.pt: is not a file of PyTorch weights"):
            training.resume()
    other = tmp_path / "other"
    other.write_bytes(whole)
    path.unlink()
    path.symlink_to(other)
    with pytest.raises(RecordingError, match="is a link, not a file of its own"):
        training.resume()


def test_a_full_disk_keeps_the_checkpoint(pictures: list[Picture], tmp_path: Path) -> None:
    training = train.Training(pictures, [], train.Settings(**QUICK), out=tmp_path)
    training._store_checkpoint()
    before = (tmp_path / train.CHECKPOINT).read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, limits[1]))
    try:
        with pytest.raises(RecordingError, match=r"last\.pt: cannot be written .*continue with --resume"):
            training._store_checkpoint()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert (tmp_path / train.CHECKPOINT).read_bytes() == before


def test_the_same_seed_gives_the_same_weights_and_a_stop_changes_nothing(
    pictures: list[Picture], tmp_path: Path
) -> None:
    whole = train.Training(pictures, pictures[:2], train.Settings(**QUICK), out=tmp_path / "whole")
    epochs = _run(whole)
    assert [e.number for e in epochs] == [1, 2]
    assert [e.evaluation is not None for e in epochs] == [False, True]

    stopped = train.Training(pictures, [], train.Settings(**QUICK), out=tmp_path / "stopped")

    class Stop(Exception):
        pass

    def stop(_: train.Epoch) -> None:
        raise Stop

    with pytest.raises(Stop):
        stopped.run(on_step=lambda *_: None, on_epoch=stop)
    resumed = train.Training(pictures, [], train.Settings(**QUICK), out=tmp_path / "stopped")
    assert resumed.resume()
    assert resumed.epochs_done == 1
    _run(resumed)
    assert resumed.weights_digest() == whole.weights_digest()
    other = train.Training(pictures, [], train.Settings(**{**QUICK, "seed": 2}), out=tmp_path / "stopped")
    with pytest.raises(ConfigError, match="other settings"):
        other.resume()
    assert not train.Training(pictures, [], train.Settings(**QUICK), out=tmp_path / "new").resume()
    # Weights of one training begin another.
    assert other.load_weights(tmp_path / "stopped" / train.CHECKPOINT)[0] > 50
    # One of a network of other blocks is told of; its tensors do not fit.
    path = tmp_path / "stopped" / train.CHECKPOINT
    data = {**torch.load(path, weights_only=True), "network": {"mid_blocks": 2}}
    del data["digest"]
    torch.save({**data, "digest": train.digest_of(data)}, path)
    with pytest.raises(ConfigError, match="other network"):
        resumed.resume()
    torch.save({"some": torch.zeros(3)}, tmp_path / "other.pt")
    with pytest.raises(ConfigError, match="no weights that fit"):
        other.load_weights(tmp_path / "other.pt")
    (tmp_path / "broken.pt").write_bytes(b"nothing")
    with pytest.raises(ConfigError, match="is not a file of PyTorch weights"):
        other.load_weights(tmp_path / "broken.pt")
    with pytest.raises(ConfigError, match="cannot be read"):
        other.load_weights(tmp_path / "missing.pt")


@pytest.mark.parametrize(("epochs", "weak", "expected"), [(6, 0, 1), (6, 4, 4), (2, 0, 1), (2, 2, 2)])
def test_the_last_epochs_have_weak_augmentation(
    pictures: list[Picture], tmp_path: Path, epochs: int, weak: int, expected: int
) -> None:
    settings = train.Settings(**{**QUICK, "epochs": epochs, "weak_epochs": weak})
    training = train.Training(pictures, [], settings, out=tmp_path)
    seen: list[str] = []
    for batches_of, kind in ((training.batches, "strong"), (training._late_batches, "weak")):
        batches_of.epoch = lambda _, kind=kind: iter((seen.append(kind),))  # type: ignore
    training._step = lambda *_: (1.0, 1.0)  # type: ignore[method-assign]
    _run(training)
    assert seen == ["strong"] * (epochs - expected) + ["weak"] * expected


def test_steps_on_the_same_pictures_make_the_loss_small(pictures: list[Picture], tmp_path: Path) -> None:
    training = train.Training(pictures, [], train.Settings(**{**QUICK, "batch": 4}), out=tmp_path)
    (batch,) = training.batches.epoch(0)
    losses = [training._step(batch, 2e-3) for _ in range(12)]
    assert losses[-1][1] < 0.75 * losses[0][1]  # of boxes
    assert sum(losses[-1]) < 0.8 * sum(losses[0])


def test_invalid_settings_and_classes_are_refused(pictures: list[Picture], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--epochs"):
        train.Settings(epochs=0)
    with pytest.raises(ConfigError, match="fp32 or bf16"):
        train.Settings(precision="int8")
    with pytest.raises(ConfigError, match="--weak-epochs: must be 0 to 4, not 5"):
        train.Settings(epochs=4, weak_epochs=5)
    with pytest.raises(ConfigError, match="--start-share: must be 0 or more and below 1, not 1"):
        train.Settings(start_share=1.0)
    with pytest.raises(ConfigError, match="no class has 1000 objects"):
        train.Training(pictures, [], train.Settings(min_objects=1000), out=tmp_path)


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Return an untrained model with widely spread outputs, so that there are boxes."""
    torch.manual_seed(3)
    net = SsdLite(3, [v.anchors_per_position for v in LEVELS])
    for head in net.heads:
        head[-1].weight.data.mul_(60.0)
        head[-1].bias.data.zero_()
    net.train()
    with torch.no_grad():
        net(torch.randn(4, 3, INPUT_PX[1], INPUT_PX[0]))  # statistics of its own
    path = tmp_path_factory.mktemp("model") / "net.onnx"
    return net.eval(), export(net, path, ("a", "b", "c"), threshold=0.3)


def test_folding_changes_rounding_alone(model: Any) -> None:
    net, _ = model
    blob = torch.randn(1, 3, INPUT_PX[1], INPUT_PX[0])
    with torch.no_grad():
        for before, after in zip(net(blob), folded(net)(blob), strict=True):
            assert torch.allclose(before, after, atol=2e-3, rtol=2e-3)
    assert not any(isinstance(m, torch.nn.BatchNorm2d) for m in folded(net).modules())


def test_a_training_begins_with_an_exported_model(pictures: list[Picture], tmp_path: Path) -> None:
    first = train.Training(pictures, [], train.Settings(**QUICK), out=tmp_path)
    _run(first)
    export(first.averaged, tmp_path / "net.onnx", first.classes, threshold=0.3)
    second = train.Training(pictures, [], train.Settings(**{**QUICK, "seed": 2}), out=tmp_path / "second")
    loaded, total = second.load_weights(tmp_path / "net.onnx")
    assert loaded == total
    blob = torch.randn(2, 3, INPUT_PX[1], INPUT_PX[0])
    with torch.no_grad():
        for before, after in zip(first.averaged(blob), second.averaged(blob), strict=True):
            assert torch.allclose(before, after, atol=2e-3, rtol=2e-3)
        # In training, the statistics are those of the batch: with the pictures of the start they change nothing.
        same = batches.blob_of([second._store.rgb(i) for i in range(len(pictures))])
        for before, after in zip(first.averaged(same), second.model.train()(same), strict=True):
            assert torch.allclose(before, after, atol=2e-2, rtol=2e-2)


def test_the_result_has_a_share_of_the_start(pictures: list[Picture], tmp_path: Path) -> None:
    """Its folded weights lie between those of the start and of the training; the training itself is as without."""
    first = train.Training(pictures, [], train.Settings(**QUICK), out=tmp_path)
    _run(first)
    export(first.averaged, tmp_path / "net.onnx", first.classes, threshold=0.3)
    trainings = []
    for share in (0.0, 0.25):
        settings = train.Settings(**{**QUICK, "seed": 2, "start_share": share})
        training = train.Training(pictures, [], settings, out=tmp_path / f"{share}")
        training.load_weights(tmp_path / "net.onnx")
        _run(training)
        trainings.append(training)
    without, shared = trainings
    assert without.result is without.averaged
    start, end = read_start_weights(tmp_path / "net.onnx").tensors, folded(without.averaged).state_dict()
    mean = shared.result.state_dict()
    assert mean.keys() == start.keys() == end.keys()
    for name, value in mean.items():
        expected = 0.25 * start[name] + 0.75 * end[name]
        assert torch.allclose(value, expected, atol=1e-5, rtol=1e-4)
    assert not torch.equal(mean["stem.0.weight"], end["stem.0.weight"])
    # A training that goes on has the start of its weights file, too.
    again = train.Training(pictures, [], shared.settings, out=shared.out)
    again.load_weights(tmp_path / "net.onnx")
    assert again.resume()
    assert again.weights_digest() == shared.weights_digest() != without.weights_digest()
    # One from other weights is refused; without a share they would have no part in the result.
    torch.save(first.model.state_dict(), tmp_path / "others.pt")
    for stopped in (shared, without):
        other = train.Training(pictures, [], stopped.settings, out=stopped.out)
        other.load_weights(tmp_path / "others.pt")
        if stopped is without:
            assert other.resume()
            continue
        with pytest.raises(ConfigError, match=r"started from other weights .*--weights from which it started"):
            other.resume()


@pytest.mark.parametrize("suffix", [".onnx", "_state.pt"])
def test_a_share_needs_weights_that_fit_the_whole_network(pictures: list[Picture], tmp_path: Path, suffix: str) -> None:
    """A part that does not fit would have a share of random numbers. Without a share, parts are welcome."""

    def training_of(share: float, classes: tuple[str, ...] = ()) -> train.Training:
        settings = train.Settings(**{**QUICK, "start_share": share})
        return train.Training(pictures, [], settings, out=tmp_path / "out", classes=classes)

    first = training_of(0.0)
    export(first.averaged, tmp_path / "net.onnx", first.classes, threshold=0.3)
    torch.save({"average": first.averaged.state_dict(), "classes": list(first.classes)}, tmp_path / "net_state.pt")
    path = tmp_path / f"net{suffix}"
    assert len(set(training_of(0.5).load_weights(path))) == 1
    assert training_of(0.5, first.classes[1:]).load_weights(path)[0] > 50  # fewer classes are all known
    more = (*first.classes, "unicorn")
    with pytest.raises(ConfigError, match=r"--start-share: needs whole weights: .*does not fit classes unicorn"):
        training_of(0.5, more).load_weights(path)
    assert training_of(0.0, more).load_weights(path)[0] > 50
    # A head of other anchors does not fit.
    if suffix == "_state.pt":
        state = {**first.averaged.state_dict(), "heads.0.1.weight": torch.zeros(1, 48, 1, 1)}
        torch.save({"average": state, "classes": list(first.classes)}, path)
        with pytest.raises(ConfigError, match="does not fit 1 of the network's "):
            training_of(0.5).load_weights(path)
        assert training_of(0.0).load_weights(path)[0] > 50


def test_a_share_needs_weights_to_start_from(tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "set", [some_objects(np.random.default_rng(2))])
    data, settings = TrainingData([folder], "all", [folder]), train.Settings(**{**QUICK, "start_share": 0.5})
    with pytest.raises(ConfigError, match="--start-share: needs weights to start from"):
        train_detector(data, settings, Console(quiet=True), out=tmp_path / "out")


def test_heads_are_matched_by_class(pictures: list[Picture], tmp_path: Path) -> None:
    first = train.Training(pictures, [], train.Settings(**QUICK), out=tmp_path)
    second = train.Training(pictures, [], train.Settings(**{**QUICK, "seed": 2}), out=tmp_path / "second")
    second.classes = tuple(reversed(first.classes))
    export(first.averaged, tmp_path / "net.onnx", first.classes, threshold=0.3)
    second.load_weights(tmp_path / "net.onnx")
    blob = torch.randn(1, 3, INPUT_PX[1], INPUT_PX[0])
    count = len(first.classes)
    with torch.no_grad():
        logits, offsets = by_anchor(first.averaged(blob), count)
        turned, same = by_anchor(second.averaged(blob), count)
    assert torch.allclose(logits.flip(-1), turned, atol=2e-3, rtol=2e-3)
    assert torch.allclose(offsets, same, atol=2e-3, rtol=2e-3)
    whole = (tmp_path / "net.onnx").read_bytes()
    (tmp_path / "net.onnx").write_bytes(whole[:5000] + whole[50_000:])
    with pytest.raises(ConfigError, match=r"--weights: .*net\.json: describes another model"):
        second.load_weights(tmp_path / "net.onnx")
    (tmp_path / "net.json").unlink()
    with pytest.raises(ConfigError, match=r"--weights: .*net\.json: cannot be read"):
        second.load_weights(tmp_path / "net.onnx")


def test_the_file_has_each_tensor_of_a_network_in_which_some_are_equal(tmp_path: Path) -> None:
    """New blocks have projections of zeros and biases of zeros, all alike."""
    net = SsdLite(3, [v.anchors_per_position for v in LEVELS])
    export(net, tmp_path / "net.onnx", ("a", "b", "c"), threshold=0.3)
    start, expected = read_start_weights(tmp_path / "net.onnx"), folded(net).state_dict()
    assert start.classes == ("a", "b", "c")
    assert start.tensors.keys() == expected.keys()
    assert all(torch.equal(start.tensors[name], value) for name, value in expected.items())


def test_a_training_begins_with_a_shipped_model_by_its_name() -> None:
    start = read_start_weights(Path("good"))
    assert start.folded
    assert "person" in start.classes


@pytest.mark.parametrize("backend", sorted(BACKENDS))
def test_back_ends_find_the_same_boxes_as_the_network(model: Any, backend: str) -> None:
    pytest.importorskip(f"hil_companion.detect.backends.{BACKENDS[backend][0]}")
    net, file = model
    detector = Detector(file, backend, threads=1)
    detector.warm_up()
    rgb = np.random.default_rng(1).integers(0, 255, (240, 320, 3)).astype(np.uint8)
    blob = torch.from_numpy(detector.blob(rgb).copy())
    with torch.no_grad():
        maps = [m.numpy() for m in net(blob)]
    expected = numpy_decode.decode(file, *numpy_by_anchor(file.levels, file.input_px, maps, 3), (320, 240))
    found = detector.detect(rgb)
    assert len(expected) > 5
    for e in expected:
        same = [f for f in found if f.label == e.label and np.abs(np.subtract(f.box_px, e.box_px)).max() < 1.0]
        assert same or e.score < 0.32, e


def test_the_description_carries_the_threshold(model: Any) -> None:
    _, file = model
    assert with_threshold(file, 0.4321).score_threshold == 0.4321
    assert with_threshold(file, 0.3).sha256 == file.sha256


def test_torch_and_numpy_decode_alike() -> None:
    torch.manual_seed(1)
    anchors = describe(Path("x.onnx"), ("a",)).anchors_px
    offsets = torch.randn(len(anchors), 4) * 5
    ours = boxes_px(torch.from_numpy(anchors), offsets).numpy()
    np.testing.assert_allclose(ours, numpy_decode.boxes_px(anchors, offsets.numpy()), rtol=1e-4, atol=1e-3)
    maps = [torch.randn(1, v.anchors_per_position * 9, *v.map_size(INPUT_PX)[::-1]) for v in LEVELS]
    logits, moved = by_anchor(maps, 5)
    numbers = numpy_by_anchor(LEVELS, INPUT_PX, [m.numpy() for m in maps], 5)
    np.testing.assert_array_equal(logits[0].numpy(), numbers[0])
    np.testing.assert_array_equal(moved[0].numpy(), numbers[1])


def test_overlap_against_figures_worked_out_by_hand() -> None:
    a = torch.tensor([[0.0, 0.0, 2.0, 2.0], [0.0, 0.0, 1.0, 1.0]])
    b = torch.tensor([[1.0, 0.0, 3.0, 2.0], [3.0, 0.0, 4.0, 1.0]])
    iou, giou = overlaps(a, b)
    assert iou.tolist() == pytest.approx([1.0 / 3.0, 0.0])
    assert giou.tolist() == pytest.approx([1.0 / 3.0, -0.5])


def test_the_loss_is_least_where_scores_are_overlaps_and_ignores_difficult_objects() -> None:
    anchors = torch.tensor([[10.0, 10.0, 8.0, 8.0], [30.0, 10.0, 8.0, 8.0], [50.0, 10.0, 8.0, 8.0]])
    found = torch.tensor([[0, -1, -2]])
    target = torch.zeros(1, 3, 4)
    target[0, 0] = torch.tensor([6.0, 6.0, 14.0, 14.0])
    offsets = torch.zeros(1, 3, 4)
    good = torch.tensor([[[20.0], [-20.0], [20.0]]])  # the third may have any score
    scores, boxes = detection_loss(good, offsets, anchors, found, target)
    assert float(scores) < 1e-6
    assert float(boxes) < 1e-6
    for wrong in ([[[-20.0], [-20.0], [0.0]]], [[[20.0], [20.0], [0.0]]]):
        assert float(detection_loss(torch.tensor(wrong), offsets, anchors, found, target)[0]) > 10.0
    empty = detection_loss(good * 0 - 20.0, offsets, anchors, torch.full((1, 3), -1), target)
    assert float(empty[0] + empty[1]) < 1e-6


def test_the_gradient_of_the_scores_loss_is_that_of_its_formula() -> None:
    torch.manual_seed(2)
    logits = (3.0 * torch.randn(2, 40, 5, dtype=torch.float64)).requires_grad_()
    wanted = torch.rand(2, 40, 5, dtype=torch.float64) * (torch.rand(2, 40, 5) > 0.8)
    counted = torch.rand(2, 40, 5) > 0.2
    own = QualityFocal.apply(logits, wanted, *torch.nonzero(~counted, as_tuple=True))
    (gradient,) = torch.autograd.grad(own * 0.5, logits)
    factor = (logits.detach().sigmoid() - wanted).square()
    formula = (factor * (torch.nn.functional.softplus(logits) - logits * wanted) * counted).sum()
    (expected,) = torch.autograd.grad(formula * 0.5, logits)
    torch.testing.assert_close(own, formula.detach())
    torch.testing.assert_close(gradient, expected)


def test_a_difficult_object_is_taught_to_be_of_no_other_class() -> None:
    """Its own class may score as it likes; a bicycle too small to count is still no person."""
    anchors = torch.tensor([[10.0, 10.0, 8.0, 8.0], [50.0, 50.0, 8.0, 8.0]])
    classes = torch.tensor([[ignored(2), BACKGROUND]])
    logits = torch.zeros(1, 2, 4).requires_grad_()
    scores, boxes = detection_loss(logits, torch.zeros(1, 2, 4), anchors, classes, torch.zeros(1, 2, 4))
    (gradient,) = torch.autograd.grad(scores, logits)
    assert boxes == 0.0
    assert (gradient > 0.0).tolist() == [[[True, True, False, True], [True] * 4]]
    assert gradient[0, 0, 2] == 0.0


def test_blocks_that_weights_lack_change_nothing(tmp_path: Path) -> None:
    """So a network can be trained on after blocks are added to it, and its start can have a share of the result."""
    torch.manual_seed(4)
    anchors = [level.anchors_per_position for level in LEVELS]
    small = SsdLite(3, anchors, Widths(mid_blocks=1, deep_blocks=2, wide_blocks=0))
    for module in small.modules():
        if isinstance(module, torch.nn.BatchNorm2d):
            torch.nn.init.uniform_(module.weight, 0.5, 1.0)
            torch.nn.init.uniform_(module.bias, -0.2, 0.2)
    small = folded(small)
    blob = torch.rand(1, 3, 96, 128)
    large = SsdLite(3, anchors)
    state = {**large.state_dict(), **normalisation_renamed(large, small.state_dict())}
    large.load_state_dict(state)
    names = new_blocks(large, small.state_dict())
    assert names == ("mid.2.", "mid.3.", "deep.3.", "deep.4.", "deep.5.", "deep.6.", "wide.1.", "wide.2.", "wide.3.")
    set_statistics(large, blob)
    for own, expected in zip(large.eval()(blob), small(blob), strict=True):
        torch.testing.assert_close(own, expected, atol=1e-4, rtol=1e-4)


def test_pictures_of_rare_things_are_drawn_more_often(pictures: list[Picture]) -> None:
    rare, common = pictures[0], pictures[1]
    many = [replace(common, labels=("vehicle",) * 3)] * 95 + [replace(rare, labels=("person",) * 3)] * 5
    factors = repeat_factors(many)
    assert factors.mean() == pytest.approx(1.0)
    assert factors[-1] / factors[0] == pytest.approx((COMMON_SHARE / 0.05) ** 0.5)
    batches = Batches(None, None, many, size=10, seed=1)  # type: ignore[arg-type]
    orders = [batches._order(np.random.default_rng(k)) for k in range(40)]
    assert {len(order) for order in orders} == {100}
    drawn = np.mean([(order >= 95).sum() for order in orders])
    assert drawn == pytest.approx(5.0 * factors[-1], rel=0.15)


def test_classes_can_be_given_and_the_input_be_larger(pictures: list[Picture], tmp_path: Path) -> None:
    settings = train.Settings(**{**QUICK, "input_px": (480, 352)})
    training = train.Training(pictures, [], settings, out=tmp_path, classes=("person", "zebra"))
    assert training.classes == ("person", "zebra")
    assert not {"person", "zebra"} & set(training.left_out)
    model = export(
        training.averaged, tmp_path / "large.onnx", training.classes, threshold=0.5, input_px=settings.input_px
    )
    assert model.input_px == (480, 352)
    assert len(model.anchors_px) == len(training._anchors)
