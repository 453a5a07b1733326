"""A fleet over MQTT with a broker in this process: what is published is heard, and failures are explained."""

from __future__ import annotations

import json
import socket
import ssl
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.train.fleet.brokers import ANONYMOUS, Authority, answering, free_port, hearing, port_of, running
from tests.train.fleet.stories import NAMES, story
from train.fleet.messages import Message
from train.fleet.publisher import PASSWORD, Broker, broker_of, publish, secure_context
from train.fleet.vehicle import messages_of
from warehouse_env.errors import ConfigError, LostError, WarehouseError

FAST = 40.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of certificates, and files that are none."""
    folder = tmp_path_factory.mktemp("certificates")
    plant = Authority(folder, "plant")
    plant.sign("broker", "DNS:localhost,IP:127.0.0.1")
    plant.sign("elsewhere", "DNS:elsewhere")
    Authority(folder, "stranger")
    (folder / "words.pem").write_text("no certificate")
    return folder


@pytest.fixture(scope="module")
def brokers(folder: Path) -> Iterator[Any]:
    """amqtt at an open port and over TLS."""
    shown = {"tls": "broker", "elsewhere": "elsewhere"}
    with running({"default": {}, **{name: secured(folder, one) for name, one in shown.items()}}, ANONYMOUS) as made:
        yield made


@pytest.fixture(scope="module")
def guarded(folder: Path) -> Iterator[Any]:
    """amqtt over TLS that asks for a password."""
    argon2 = pytest.importorskip("argon2")
    digest = argon2.PasswordHasher(time_cost=1, memory_cost=8, parallelism=1).hash("secret")
    (folder / "passwords").write_text(f"dispatcher:{digest}\n")
    plugins = {"amqtt.plugins.authentication.FileAuthPlugin": {"password_file": str(folder / "passwords")}}
    with running({"default": secured(folder, "broker")}, plugins) as made:
        yield made


def secured(folder: Path, name: str) -> dict[str, Any]:
    """Return a listener's options for TLS with a certificate of this name."""
    return {"ssl": True, "certfile": str(folder / f"{name}.pem"), "keyfile": str(folder / f"{name}.key")}


def told(messages: list[Message]) -> list[tuple[str, Any]]:
    return [(message.topic, message.payload) for message in messages]


def told_to(heard: list[Any]) -> list[tuple[str, Any]]:
    return [(str(message.topic), json.loads(message.payload)) for message in heard]


def test_what_is_published_is_heard(brokers: Any) -> None:
    broker, messages = Broker("127.0.0.1", port_of(brokers)), list(messages_of(story(), NAMES))
    with hearing(broker, NAMES.interface) as heard:
        assert publish(broker, messages, NAMES, ["00000"], FAST).messages == len(messages)
    assert told_to(heard) == told(messages)


def test_over_tls_with_a_password(guarded: Any, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    messages = list(messages_of(story(), NAMES))
    broker = Broker("localhost", port_of(guarded), "dispatcher", secure_context(folder / "plant.pem"))
    for password, who in ((None, None), ("wrong", "dispatcher")):
        monkeypatch.delenv(PASSWORD, raising=False) if password is None else monkeypatch.setenv(PASSWORD, password)
        with pytest.raises(WarehouseError, match=f"refuses .*; check --user and the password in {PASSWORD}"):
            publish(broker._replace(user=who), messages, NAMES, ["00000"], FAST)
    monkeypatch.setenv(PASSWORD, "secret")
    with hearing(broker, NAMES.interface) as heard:
        publish(broker, messages, NAMES, ["00000"], FAST)
    assert told_to(heard) == told(messages)


def test_a_stopped_publisher_says_offline(brokers: Any) -> None:
    def stopped() -> Iterator[Message]:
        yield from [message for message in messages_of(story(), NAMES) if message.seconds < 2]
        raise KeyboardInterrupt

    broker = Broker("127.0.0.1", port_of(brokers))
    with hearing(broker, NAMES.interface) as heard, pytest.raises(KeyboardInterrupt):
        publish(broker, stopped(), NAMES, ["00000"], FAST)
    topic, payload = told_to(heard)[-1]
    assert (topic[-10:], payload["connectionState"]) == ("connection", "OFFLINE")


def test_a_broker_that_goes_away_is_an_error() -> None:
    where = Broker("127.0.0.1", answering(b"\x20\x02\x00\x00"), timeout=1.0)
    with pytest.raises(LostError, match=r"no longer answers .*messages were sent"):
        publish(where, messages_of(story(), NAMES), NAMES, ["00000"], 1.0)


def test_failed_connections_are_explained(brokers: Any, folder: Path) -> None:
    trusted, strange = (secure_context(folder / f"{name}.pem") for name in ("plant", "stranger"))
    unanswered = "does not answer: check host and port; a TLS port needs --tls or --cafile"
    with socket.create_server(("127.0.0.1", 0)) as mute:  # accepts connections and never answers
        for port, context, says in (
            (free_port(), None, "cannot be reached: "),
            (mute.getsockname()[1], None, unanswered),
            (port_of(brokers, "tls"), None, unanswered),
            (answering(b"HTTP/1.1 400"), trusted, "does not answer in TLS at this port"),
            (port_of(brokers, "tls"), strange, "is not trusted .*; name its authority's file with --cafile"),
            (port_of(brokers, "elsewhere"), trusted, "is not trusted .*, and the broker as its certificate does"),
        ):
            where = Broker("localhost", port, context=context, timeout=0.3)
            with pytest.raises(WarehouseError, match=rf"broker localhost:{port} .*({says})"):
                publish(where, messages_of(story(), NAMES), NAMES, ["00000"], 1.0)


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("none.pem", "none.pem does not exist"),
        (".", "must be a regular file, not a folder"),
        ("words.pem", "holds no certificate in PEM format"),
    ],
)
def test_unsuitable_certificates_are_explained(name: str, says: str, folder: Path) -> None:
    with pytest.raises(ConfigError, match=says):
        secure_context(folder / name)


def test_brokers_are_named_as_hosts_with_ports() -> None:
    assert broker_of("plant")[:2] == ("plant", 1883)
    assert broker_of("10.0.0.1:99")[:2] == ("10.0.0.1", 99)
    assert broker_of("[::1]:1884")[:2] == ("::1", 1884)
    assert broker_of("plant", context=ssl.create_default_context()).port == 8883
    for wrong in ("", ":1", "a:b", "a:70000", "mqtt://a", "a" * 300, "::1"):
        with pytest.raises(ConfigError, match="name it as HOST"):
            broker_of(wrong)
