"""The RayJob of the how-to page: its fields and types are those of KubeRay's definition, v1 of ray.io."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import yaml

from train.cli import COMMANDS, _options, _options_of

PATH = Path(__file__).parents[2] / "docs" / "how_to" / "rayjob.yaml"


def _closed(required: str, **properties: Any) -> dict[str, Any]:
    return {
        "type": "object", "properties": properties, "required": required.split(), "additionalProperties": False
    }  # fmt: skip


TEXT, WHOLE = {"type": "string", "minLength": 1}, {"type": "integer", "minimum": 0}
NAME = {"type": "string", "pattern": "^[a-z0-9]([-a-z0-9]*[a-z0-9])?$"}
QUANTITY = {"type": "string", "pattern": r"^[0-9]+(\.[0-9]+)?(m|Ki|Mi|Gi|Ti)?$"}
AMOUNTS = _closed("cpu memory", cpu=QUANTITY, memory=QUANTITY)
CONTAINER = _closed(
    "name image resources", name=NAME, image=TEXT,
    resources=_closed("requests limits", requests=AMOUNTS, limits=AMOUNTS),
    volumeMounts={"type": "array", "items": _closed("name mountPath", name=NAME, mountPath=TEXT)},
)  # fmt: skip
VOLUME = _closed("name", name=NAME, persistentVolumeClaim=_closed("claimName", claimName=NAME))
POD = _closed(
    "spec", spec=_closed("containers", containers={"type": "array", "minItems": 1, "items": CONTAINER},
                         volumes={"type": "array", "items": VOLUME}),
)  # fmt: skip
PARAMETERS = {"type": "object", "additionalProperties": {"type": "string"}}  # texts, numbers as well
WORKERS = _closed(
    "groupName replicas minReplicas maxReplicas rayStartParams template", groupName=NAME, replicas=WHOLE,
    minReplicas=WHOLE, maxReplicas=WHOLE, rayStartParams=PARAMETERS, template=POD,
)  # fmt: skip
CLUSTER = _closed(
    "rayVersion headGroupSpec workerGroupSpecs", rayVersion=TEXT,
    headGroupSpec=_closed("rayStartParams template", rayStartParams=PARAMETERS, template=POD),
    workerGroupSpecs={"type": "array", "items": WORKERS, "minItems": 1},
)  # fmt: skip
SCHEMA = _closed(
    "apiVersion kind metadata spec", apiVersion={"const": "ray.io/v1"}, kind={"const": "RayJob"},
    metadata=_closed("name", name=NAME),
    spec=_closed(
        "entrypoint rayClusterSpec", entrypoint=TEXT, backoffLimit=WHOLE, shutdownAfterJobFinishes={"type": "boolean"},
        ttlSecondsAfterFinished=WHOLE, rayClusterSpec=CLUSTER,
    ),
)  # fmt: skip


@pytest.fixture
def job() -> Any:
    return yaml.safe_load(PATH.read_text(encoding="utf-8"))


def test_it_is_a_rayjob(job: Any) -> None:
    jsonschema.validate(job, SCHEMA)
    mounts = {mount["name"] for mount in job["spec"]["rayClusterSpec"]["headGroupSpec"]["template"]["spec"]["volumes"]}
    head = job["spec"]["rayClusterSpec"]["headGroupSpec"]["template"]["spec"]["containers"][0]
    assert {mount["name"] for mount in head["volumeMounts"]} <= mounts


def test_a_field_of_another_name_or_type_is_found(job: Any) -> None:
    wrong = copy.deepcopy(job)
    wrong["spec"]["rayClusterSpec"]["headGroupSpec"]["rayStartParams"]["num-cpus"] = 0
    with pytest.raises(jsonschema.ValidationError, match="0 is not of type 'string'"):
        jsonschema.validate(wrong, SCHEMA)
    job["spec"]["entryPoint"] = job["spec"].pop("entrypoint")
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(job, SCHEMA)


def test_its_command_is_one_of_ours_and_its_version_the_pinned_one(job: Any) -> None:
    pytest.importorskip("ray")
    program, command, *options = job["spec"]["entrypoint"].split()
    assert program == "warehouse"
    assert command in COMMANDS
    made = _options(_options_of(command), f"warehouse {command}", options)
    assert made.ray == "auto"
    pins = PATH.parents[2].joinpath("constraints.txt").read_text(encoding="utf-8").splitlines()
    assert f"ray=={job['spec']['rayClusterSpec']['rayVersion']}" in pins
