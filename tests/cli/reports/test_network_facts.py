"""`jotlight info` of networks."""

import pytest

import jotlight as jl

COLUMNS = "step", "loss", "gradient_norm", "test_psnr", "held_out"


@pytest.mark.parametrize(
    "history",
    [
        {"run": 5, "records": {}},
        {"run": {}, "records": [1]},
        {"run": 5, "records": {name: [0] for name in COLUMNS}},
        {"run": {}, "records": {name: [] for name in COLUMNS}},
        {"run": {}, "records": {name: ["a"] for name in COLUMNS}},
        {"run": {}, "records": {name: [10**400] for name in COLUMNS}},
        {"fine tuning": {"run": [], "records": None}},
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


@pytest.mark.parametrize("history", [{"fine tuning": 3}, {"run": {}}, {"records": 1}], ids=str)
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
