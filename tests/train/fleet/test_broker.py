"""A fleet over MQTT with brokers in this process: what is published is heard, also over TLS; failures are explained."""

from __future__ import annotations

import re
import socket
import ssl
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.train.fleet.brokers import ANONYMOUS, Authority, Scripted, free_port, port_of, running, until
from tests.train.fleet.stories import NAMES, lines, story
from train.cli import LOST, main
from train.fleet import listen
from train.fleet.broker import PASSWORD, Broker, broker_of, secure_context
from train.fleet.build import episode_of
from train.fleet.check import check_log
from train.fleet.listen import Heard, ListenLimits, hear_broker
from train.fleet.messages import Message
from train.fleet.publisher import publish
from train.fleet.write import messages_of, write_floor
from warehouse_env.config import EnvConfig
from warehouse_env.errors import ConfigError, WarehouseError

FAST = 40.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder of certificates, and files that are none."""
    folder = tmp_path_factory.mktemp("certificates")
    plant = Authority(folder, "plant")
    plant.sign("broker", "DNS:localhost,IP:127.0.0.1")
    plant.sign("elsewhere", "DNS:elsewhere")
    plant.sign("client", "DNS:client")
    Authority(folder, "stranger").sign("unknown", "DNS:client")
    (folder / "words.key").write_text("no key")
    return folder


@pytest.fixture(scope="module")
def brokers(folder: Path) -> Iterator[Any]:
    """amqtt at an open port and over TLS."""
    shown = {"tls": "broker", "elsewhere": "elsewhere"}
    with running({"default": {}, **{name: secured(folder, one) for name, one in shown.items()}}, ANONYMOUS) as made:
        yield made


@pytest.fixture(scope="module")
def guarded(folder: Path) -> Iterator[Any]:
    """amqtt that asks for a client's certificate and a password."""
    argon2 = pytest.importorskip("argon2")
    digest = argon2.PasswordHasher(time_cost=1, memory_cost=8, parallelism=1).hash("secret")
    (folder / "passwords").write_text(f"dispatcher:{digest}\n")
    listener = secured(folder, "broker") | {"cafile": str(folder / "plant.pem")}
    plugins = {"amqtt.plugins.authentication.FileAuthPlugin": {"password_file": str(folder / "passwords")}}
    with running({"default": listener}, plugins) as made:
        yield made


def secured(folder: Path, name: str) -> dict[str, Any]:
    """Return a listener's options for TLS with a certificate of this name."""
    return {"ssl": True, "certfile": str(folder / f"{name}.pem"), "keyfile": str(folder / f"{name}.key")}


def hearing(pool: ThreadPoolExecutor, made: Any, broker: Broker, folder: Path, **limits: Any) -> Any:
    """Listen in another thread; return the future result, once it listens."""
    before = listeners(made)
    future = pool.submit(hear_broker, broker, NAMES.interface, folder, ListenLimits(**{"patience": 3.0, **limits}))
    until(lambda: bool(listeners(made) - before))
    return future


def listeners(made: Any) -> set[str]:
    """Return the listeners at amqtt, by the last topic of a subscription."""
    return {session.client_id for session, _ in made._subscriptions.get("uagv/+/+/+/instantActions", ())}


def told(messages: list[Message]) -> list[tuple[str, Any]]:
    return [(message.topic, message.payload) for message in messages]


def test_what_is_published_is_heard(brokers: Any, tmp_path: Path) -> None:
    broker, messages = Broker("127.0.0.1", port_of(brokers)), list(messages_of(story(), NAMES))
    with ThreadPoolExecutor() as pool:
        future = hearing(pool, brokers, broker, tmp_path / "a")
        assert publish(broker, messages, NAMES, ["00000"], FAST).messages == len(messages)
        heard: Heard = future.result(10)
    assert (heard.why, heard.stopped) == ("all vehicles are offline", None)
    entries = lines(tmp_path / "a" / "messages.jsonl")
    assert [(entry["topic"], entry["payload"]) for entry in entries] == told(messages)
    assert check_log(tmp_path / "a").total == 0
    with pytest.raises(ConfigError, match="holds messages already"):
        hear_broker(broker, "uagv", tmp_path / "a", ListenLimits(1.0))
    with pytest.raises(WarehouseError, match=r"no vehicle said anything at 127.0.0.1:\d+ .*nothing came for 0.2 s"):
        hear_broker(broker, "uagv", tmp_path / "b", ListenLimits(0.2))  # the retained OFFLINE does not count
    assert not (tmp_path / "b" / "messages.jsonl").exists()


def test_over_tls_with_certificates_and_a_password(
    guarded: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    context = secure_context(folder / "plant.pem", folder / "client.pem", folder / "client.key")
    broker = Broker("localhost", port_of(guarded), "dispatcher", context)
    for password, who in ((None, None), ("wrong", "dispatcher")):
        monkeypatch.delenv(PASSWORD, raising=False) if password is None else monkeypatch.setenv(PASSWORD, password)
        with pytest.raises(WarehouseError, match=f"refuses .*; check --user and the password in {PASSWORD}"):
            hear_broker(broker._replace(user=who), "uagv", tmp_path / "none", ListenLimits(1.0))
    monkeypatch.setenv(PASSWORD, "secret")
    messages = list(messages_of(story(), NAMES))
    with ThreadPoolExecutor() as pool:
        future = hearing(pool, guarded, broker, tmp_path)
        publish(broker, messages, NAMES, ["00000"], FAST)
        assert future.result(10).fleet.messages == len(messages)


def test_a_stopped_publisher_says_offline(brokers: Any, tmp_path: Path) -> None:
    def stopped() -> Iterator[Message]:
        yield from [message for message in messages_of(story(), NAMES) if message.seconds < 2]
        raise KeyboardInterrupt

    broker = Broker("127.0.0.1", port_of(brokers))
    with ThreadPoolExecutor() as pool:
        future = hearing(pool, brokers, broker, tmp_path)
        with pytest.raises(KeyboardInterrupt):
            publish(broker, stopped(), NAMES, ["00000"], FAST)
        future.result(10)
    last = lines(tmp_path / "messages.jsonl")[-1]
    assert (last["topic"][-10:], last["payload"]["connectionState"]) == ("connection", "OFFLINE")
    assert check_log(tmp_path).total == 0


@pytest.mark.parametrize("publishes", [True, False])
def test_failed_connections_are_explained(publishes: bool, brokers: Any, folder: Path, tmp_path: Path) -> None:
    def call(where: Broker) -> object:
        if publishes:
            return publish(where, messages_of(story(), NAMES), NAMES, ["00000"], 1.0)
        return hear_broker(where, "uagv", tmp_path, ListenLimits(1.0))

    trusted, strange = (secure_context(folder / f"{name}.pem", None, None) for name in ("plant", "stranger"))
    unanswered = "does not answer: check host and port; a TLS port needs --tls or --cafile"
    with socket.create_server(("127.0.0.1", 0)) as mute:  # accepts connections and never answers
        for port, context, says in (
            (free_port(), None, "cannot be reached: "),
            (mute.getsockname()[1], None, unanswered),
            (port_of(brokers, "tls"), None, unanswered),
            (Scripted([], greeting=b"HTTP/1.1 400").port, trusted, "does not answer in TLS at this port"),
            (port_of(brokers, "tls"), strange, "is not trusted .*; name its authority's file with --cafile"),
            (port_of(brokers, "elsewhere"), trusted, "is not trusted .*, and the broker as its certificate does"),
        ):
            where = Broker("localhost", port, context=context, timeout=0.3)
            with pytest.raises(WarehouseError, match=rf"broker localhost:{port} .*({says})"):
                call(where)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("files", "says"),
    [
        (("none.pem", None, None), "none.pem does not exist"),
        ((".", None, None), "must be a regular file, not a folder"),
        (("words.key", None, None), "holds no certificate in PEM format"),
        ((None, "client.pem", None), "--cert and --key go together"),
        ((None, "client.pem", "words.key"), "must be a certificate and a key in PEM format"),
        ((None, "client.pem", "unknown.key"), "do not match"),
        ((None, "client.pem", "locked.key"), "has a passphrase; write one without: openssl pkey"),
    ],
)
def test_unsuitable_files_are_explained(files: tuple[str | None, ...], says: str, folder: Path) -> None:
    (folder / "locked.key").write_text(LOCKED)
    with pytest.raises(ConfigError, match=says):
        secure_context(*(None if name is None else folder / name for name in files))


# A throw-away key with the passphrase "x": openssl genpkey -algorithm ed25519 -aes128 -pass pass:x
LOCKED = """-----BEGIN ENCRYPTED PRIVATE KEY-----
MIGbMFcGCSqGSIb3DQEFDTBKMCkGCSqGSIb3DQEFDDAcBAj7lu4rQQYNLQICCAAw
DAYIKoZIhvcNAgkFADAdBglghkgBZQMEAQIEENFJrZB2jpb/q1FkEX5jxNMEQERo
e36w86YjlE/aYTySBPGnfuGG3iurj5KFWtjApQnlJ8NcS/q7rKEdq4pQbgWkuJHr
urdtyheFWDWN1QqhnmI=
-----END ENCRYPTED PRIVATE KEY-----
"""


def test_a_broken_connection_is_made_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listen, "AGAIN", 0.05)
    messages = list(messages_of(story(), NAMES))
    again = messages[0]  # retained by the broker, and sent once more
    scripted = Scripted(messages[:9], [], [again, *messages[12:]])
    heard = hear_broker(Broker("127.0.0.1", scripted.port), "uagv", tmp_path, ListenLimits(5.0))
    assert (heard.why, heard.stopped) == ("all vehicles are offline", None)
    assert told(messages[:9] + messages[12:]) == [
        (entry["topic"], entry["payload"]) for entry in lines(tmp_path / "messages.jsonl") if entry["payload"] != again
    ]
    assert len(heard.fleet.gaps) == 1
    made = episode_of(heard.fleet, story().replay.grid, EnvConfig())
    assert any(note.startswith("the connection to the broker broke 1 time") for note in made.notes)


def test_a_lost_broker_is_an_exit_code(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(listen, "AGAIN", 0.05)
    write_floor(story(), tmp_path)
    command = ["fleet", "--map", str(tmp_path / "floor.yaml"), "--patience", "0.2", "--listen"]
    for number, messages in enumerate((list(messages_of(story(), NAMES))[:20], [])):
        folder = tmp_path / str(number)
        assert main([*command, f"127.0.0.1:{Scripted(messages).port}", "--out", str(folder)]) == LOST
        out, error = capsys.readouterr()
        assert re.search(r"warehouse: broker 127.0.0.1:\d+ went away .* and did not come back", error)
        assert "Traceback" not in out + error
        assert (folder / "episode.npz").exists() == (folder / "messages.jsonl").exists() == bool(messages)
        assert (f"what came is kept in {folder}" in error) == bool(messages)


def test_a_refused_subscription_is_explained(tmp_path: Path) -> None:
    scripted = Scripted([], granted=0x80)
    with pytest.raises(WarehouseError, match="does not let user 'guest' read below uagv/; have it allowed"):
        hear_broker(Broker("127.0.0.1", scripted.port, "guest"), "uagv", tmp_path, ListenLimits(1.0))


def test_brokers_are_named_as_hosts_with_ports() -> None:
    assert broker_of("plant")[:2] == ("plant", 1883)
    assert broker_of("10.0.0.1:99")[:2] == ("10.0.0.1", 99)
    assert broker_of("[::1]:1884")[:2] == ("::1", 1884)
    assert broker_of("plant", context=ssl.create_default_context()).port == 8883
    for wrong in ("", ":1", "a:b", "a:70000", "mqtt://a", "a" * 300, "::1"):
        with pytest.raises(ConfigError, match="name it as HOST"):
            broker_of(wrong)
