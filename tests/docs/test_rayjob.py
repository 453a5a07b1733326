"""The RayJob of the how-to page: a job of KubeRay whose command is one of ours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from train.cli import COMMANDS, _options, options_of

PATH = Path(__file__).parents[2] / "docs" / "how_to" / "rayjob.yaml"


@pytest.fixture
def job() -> Any:
    return yaml.safe_load(PATH.read_text(encoding="utf-8"))


def test_it_is_a_rayjob_whose_volumes_are_there(job: Any) -> None:
    assert (job["apiVersion"], job["kind"]) == ("ray.io/v1", "RayJob")
    cluster = job["spec"]["rayClusterSpec"]
    for group in (cluster["headGroupSpec"], *cluster["workerGroupSpecs"]):
        assert all(isinstance(value, str) for value in group["rayStartParams"].values())
        pod = group["template"]["spec"]
        mounts = {mount["name"] for one in pod["containers"] for mount in one.get("volumeMounts", ())}
        assert mounts <= {volume["name"] for volume in pod.get("volumes", ())}


def test_its_command_is_one_of_ours_and_its_version_the_pinned_one(job: Any) -> None:
    pytest.importorskip("ray")
    program, command, *options = job["spec"]["entrypoint"].split()
    assert program == "warehouse"
    assert command in COMMANDS
    made = _options(options_of(command), f"warehouse {command}", options)
    assert made.ray == "auto"
    pins = PATH.parents[2].joinpath("constraints.txt").read_text(encoding="utf-8").splitlines()
    assert f"ray=={job['spec']['rayClusterSpec']['rayVersion']}" in pins
