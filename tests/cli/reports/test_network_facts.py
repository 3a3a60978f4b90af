"""`jotlight info` of networks."""

import pytest

import jotlight as jl
from jotlight.networks.pretrained import FOLDER

COLUMNS = "step", "loss", "gradient_norm", "test_psnr", "held_out"


def of_run(run, records):
    """Return a history that is one run of training."""
    return {"stages": [{"kind": "train", "run": run, "records": records}]}


@pytest.mark.parametrize(
    "history",
    [
        of_run(5, {}),
        of_run({}, [1]),
        of_run(5, {name: [0] for name in COLUMNS}),
        of_run({}, {name: [] for name in COLUMNS}),
        of_run({}, {name: ["a"] for name in COLUMNS}),
        of_run({}, {name: [10**400] for name in COLUMNS}),
        {"stages": {}},
        {"stages": [3]},
        {"stages": [{"kind": "train"}]},
        {"stages": [{"kind": []}]},
        {"stages": [{"kind": "mend", "run": {}, "records": {name: [0] for name in COLUMNS}}]},
    ],
    ids=str,
)
def test_a_network_with_a_damaged_history_is_refused(run, history):
    jl.Network(jl.Network.initial(jl.Sensor()).layers, jl.Sensor(), history).save("a.safetensors")
    for options in ([], ["--plot", "b.png"]):
        status, output = run("info", "a.safetensors", *options)
        assert status == 1
        assert output.startswith("error: a.safetensors: history: expected")
        assert output.count("\n") == 1


@pytest.mark.parametrize("history", [{}, {"stages": []}, {"stages": ["by hand"]}], ids=str)
def test_a_network_without_records_of_a_run_has_no_plot(run, history):
    jl.Network(jl.Network.initial(jl.Sensor()).layers, jl.Sensor(), history).save("a.safetensors")
    assert run("info", "a.safetensors")[0] == 0
    status, output = run("info", "a.safetensors", "--plot", "b.png")
    assert (status, "no history of a training run" in output) == (1, True)


@pytest.mark.parametrize(
    ("network", "kind", "start"),
    [
        (jl.ColorNetwork, "color network", "starts at classical colors"),
        (jl.FilmNetwork, "film network", "starts at the gray network"),
    ],
)
def test_networks_of_other_kinds_are_described(run, tmp_path, network, kind, start):
    network.initial("small", rng=0).save(tmp_path / "network.safetensors")
    status, output = run("info", "network.safetensors")
    assert status == 0
    assert kind in output
    assert start in output


def test_a_run_is_described_with_all_stages_before_it(run):
    history = {"start": "large", "stages": ["two steps by hand"]}
    records = {"step": [0, 1], "loss": [2.0, 1.0], "gradient_norm": [1, 1]}
    records |= {"test_psnr": [20.0, 21.0], "held_out": [None, None]}
    stage = {"kind": "train", "data": "photos", "run": {"optimizer": "Adam", "seed": 3}}
    history["stages"].append({**stage, "records": records})
    network = jl.Network(jl.Network.initial(jl.Sensor()).layers, jl.Sensor(), history)
    network.save("a.safetensors")
    status, output = run("info", "a.safetensors")
    assert status == 0
    lines = [" ".join(line.split()) for line in output.splitlines()]
    start = lines.index("start large")
    assert lines[start + 1] == "stage 1 two steps by hand"
    text = " ".join(lines[start + 2 :])
    assert text.startswith("stage 2 trained on photos: 1 step of Adam, seed 3; cost 2 to 1, test ")


@pytest.mark.parametrize(
    ("file", "text"),
    [("two-layer-k16", "trained on BSDS300 train, gray: 60 steps"), ("film", "on the images of")],
)
def test_the_stages_of_pretrained_networks_are_described(run, file, text):
    status, output = run("info", FOLDER / f"{file}.safetensors")
    assert status == 0
    assert text in " ".join(output.split())
