"""Training in several processes, devices, and threads."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jotlight as jl

torch = pytest.importorskip("torch")
from jotlight.torch import fine_tune, fine_tuning, train  # noqa: E402
from jotlight.torch.distributed import ProcessGroup, choose_device, process_group, rank  # noqa: E402
from servers import http_server  # noqa: E402
from training_runs import end_after  # noqa: E402

SCENE = np.kron([[0.1, 0.7, 0.3], [0.9, 0.2, 0.5], [0.4, 0.8, 0.1]], np.ones((16, 16)))
BITS = jl.Sensor(frames=8).expose(SCENE, rng=0)
IMAGES = np.random.default_rng(0).random((5, 20, 24), np.float32)
# The launcher takes long to start, so one script makes all runs.
SCRIPT = """
import json, sys
from pathlib import Path
import numpy as np
import torch
import jotlight as jl
from jotlight.torch import train

folder = Path(sys.argv[1])


def train_several_times(group):
    network = jl.Network.residual(jl.Sensor(frames=4), "small", rng=0)
    for seed in (3, 2**70, 5):
        train(network, np.ones((2, 8, 8), np.float32), steps=1, batch=2, rng=seed, device="cpu")
    (folder / f"{group} group, is there: {torch.distributed.is_initialized()}").touch()


def train_until(last):
    network = jl.Network.residual(jl.Sensor(oversampling=3), "small", rng=0)
    images = np.random.default_rng(0).random((5, 20, 24), np.float32)
    records = []

    def callback(record):
        records.append(record)
        if record.step >= last:
            raise StopIteration

    trained, history = train(
        network, images, steps=4, batch=5, patch=12, rng=3, threads=1, device="cpu",
        test=list(images[:1]), callback=callback, checkpoint=folder / f"run {last}",
    )
    if records:
        trained.save(folder / f"{last}.safetensors")
        print(json.dumps([last, history.to_json(), len(records)]))


torch.distributed.init_process_group("gloo")
train_several_times("own")
torch.distributed.barrier()
torch.distributed.destroy_process_group()
train_several_times("no")
train_until(9)
train_until(1)
"""


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Return the folder of the script's runs in two processes, and what the script printed."""
    folder = tmp_path_factory.mktemp("runs")
    (folder / "runs.py").write_text(SCRIPT, "utf-8")
    launcher = [sys.executable, "-m", "torch.distributed.run", "--standalone"]
    printed = subprocess.run(
        [*launcher, "--nproc-per-node", "2", folder / "runs.py", folder],
        check=True,
        stdout=subprocess.PIPE,
        text=True,
        timeout=300,
        env={**os.environ, "PYTHONPATH": str(Path(jl.__file__).parents[1])},
    ).stdout
    return folder, [json.loads(line) for line in printed.splitlines()]


@pytest.mark.slow
@pytest.mark.parametrize("last", [9, 1])  # with 1, the callback of the main process ends both
def test_two_processes_train_the_network_that_one_process_trains(runs, last):
    folder, printed = runs
    # The main process alone prints.
    assert [line[0] for line in printed] == [9, 1]
    history, number = next(line[1:] for line in printed if line[0] == last)
    assert number == len(history["step"]) == min(5, last + 2)
    assert (folder / f"run {last}").is_file()
    alone, history_alone = train(
        jl.Network.residual(jl.Sensor(oversampling=3), "small", rng=0), IMAGES, steps=4, batch=5,
        patch=12, rng=3, threads=1, device="cpu", test=list(IMAGES[:1]), callback=end_after(last),
    )  # fmt: skip
    np.testing.assert_allclose(history["loss"], history_alone.loss, rtol=1e-4)
    np.testing.assert_allclose(history["gradient_norm"], history_alone.gradient_norm, rtol=1e-3)
    together = jl.Network.load(folder / f"{last}.safetensors")
    for layer, other in zip(alone.layers, together.layers, strict=True):
        np.testing.assert_allclose(layer.filters, other.filters, atol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("group", "is_there"), [("own", True), ("no", False)])
def test_a_script_trains_several_times_also_in_its_own_group(runs, group, is_there):
    """Training leaves a group of the script, and ends its own."""
    folder, _ = runs
    (found,) = folder.glob(f"{group} group*")
    assert found.name == f"{group} group, is there: {is_there}"


@pytest.mark.parametrize("seed", [2**63, 2**200])
def test_seeds_may_be_large(seed):
    network = jl.Network.residual(jl.Sensor(frames=8), "small", rng=0)
    trained, _ = train(network, IMAGES, steps=1, batch=1, patch=8, rng=seed, device="cpu")
    assert trained.history["stages"][-1]["run"]["seed"] == seed


def test_a_group_of_the_script_is_used_and_stays(tmp_path, monkeypatch):
    monkeypatch.setenv("WORLD_SIZE", "2")
    monkeypatch.setenv("RANK", "1")
    store = torch.distributed.FileStore(str(tmp_path / "store"), 1)
    torch.distributed.init_process_group("gloo", store=store, rank=0, world_size=1)
    try:
        for _ in range(2):
            with process_group(torch.device("cpu")) as group:
                assert (group.rank, group.world_size) == (rank(), 1) == (0, 1)
            assert torch.distributed.is_initialized()
    finally:
        torch.distributed.destroy_process_group()


def test_the_gradients_of_two_processes_add_up_to_that_of_one(monkeypatch):
    """The processes run one after the other here."""
    losses, gradients = [], []

    class RecordingGroup(ProcessGroup):
        def all_reduce_sum(self, tensor):
            losses.append(float(tensor[0]))
            gradients.append(tensor[1:].clone())

    for group in (RecordingGroup(0, 1), RecordingGroup(0, 2), RecordingGroup(1, 2)):
        monkeypatch.setattr(
            fine_tuning, "process_group", lambda _, group=group: contextlib.nullcontext(group)
        )
        monkeypatch.setattr(ProcessGroup, "broadcast", lambda *_: None)
        monkeypatch.setattr(ProcessGroup, "shared", lambda _, value: value)
        fine_tune(
            jl.Network.conditional("small", rng=0), BITS, steps=1, batch=5, patch=24, rng=3,
            threads=1, device="cpu",
        )  # fmt: skip
    # Each run measures twice, and the second time is that of its result.
    whole, first, second = range(0, 6, 2)
    assert losses[first] + losses[second] == pytest.approx(losses[whole], rel=1e-5)
    total = gradients[first] + gradients[second]
    torch.testing.assert_close(total, gradients[whole], rtol=1e-3, atol=1e-6)


def test_the_shards_of_all_processes_divide_a_batch():
    patches = np.arange(7)
    shards = [patches[ProcessGroup(number, 3).shard] for number in range(3)]
    np.testing.assert_array_equal(np.sort(np.concatenate(shards)), patches)
    assert max(map(len, shards)) - min(map(len, shards)) <= 1


def test_only_the_first_process_is_the_main_one(monkeypatch):
    assert [ProcessGroup(number, 3).is_main for number in range(3)] == [True, False, False]
    monkeypatch.delenv("RANK", raising=False)
    assert rank() == 0
    monkeypatch.setenv("RANK", "2")
    assert rank() == 2


def test_each_process_has_its_own_gpu(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setenv("LOCAL_RANK", "1")
    assert choose_device(None) == choose_device("cuda") == torch.device("cuda", 1)
    assert choose_device("cuda:0") == torch.device("cuda", 0)
    assert choose_device("cpu") == torch.device("cpu")


def test_a_missing_gpu_is_an_error_unless_the_choice_is_free(monkeypatch):
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    assert choose_device(None) == torch.device("cpu")
    with pytest.raises(ValueError, match="device: expected cpu, since PyTorch finds no GPU"):
        choose_device("cuda")


@pytest.mark.parametrize("device", ["gpu", "GPU", "cuda:x", "cpu:", ""])
def test_an_unknown_device_is_an_error(device):
    with pytest.raises(ValueError, match=f"device: expected 'cpu', 'cuda', .* got '{device}'"):
        choose_device(device)


@pytest.mark.slow
@pytest.mark.exhaustive
def test_torchrun_trains_on_examples_from_a_folder_of_urls(tmp_path):
    pytest.importorskip("fsspec")
    rng = np.random.default_rng(0)
    (tmp_path / "photographs").mkdir()
    for index in range(3):
        jl.save_image(tmp_path / "photographs" / f"{index}.png", rng.random((150, 150, 3)))
    script = tmp_path / "own.py"
    with http_server(tmp_path) as server:
        url = f"{server.url}/photographs/"
        script.write_text(
            "import os\n"
            "import jotlight as jl\n"
            "from jotlight.training import UrlPhotographs\n"
            f"source = UrlPhotographs({url!r}, max_side=128)\n"
            "network = jl.Network.residual(jl.Sensor(frames=16), 'small')\n"
            "network, history = jl.torch.train(network, source, steps=2, rng=0)\n"
            "network.save(f\"{os.environ['RANK']}.safetensors\")\n"
        )
        command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node", "2"]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        subprocess.run(
            [*command, str(script)], cwd=tmp_path, env=environment, check=True, timeout=300
        )
        fetched = {path for path, _ in server.requests if path.endswith(".png")}
    assert fetched <= {f"/photographs/{index}.png" for index in range(3)}
    assert fetched
    networks = [jl.Network.load(tmp_path / f"{rank}.safetensors") for rank in (0, 1)]
    for first, second in zip(networks[0].layers, networks[1].layers, strict=True):
        np.testing.assert_array_equal(first.filters, second.filters)
