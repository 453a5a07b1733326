"""Over TLS and with passwords: who is let in hears all; who is not is told why, and what to do."""

from __future__ import annotations

import contextlib
import socket
import ssl
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from tests.train.fleet.brokers import ANONYMOUS, Authority, port_of, running, until
from tests.train.fleet.stories import NAMES, lines, story
from train.cli import main
from train.fleet.broker import PASSWORD, Broker
from train.fleet.check import check_log
from train.fleet.greeting import greet
from train.fleet.listen import Heard, hear_broker
from train.fleet.publisher import publish
from train.fleet.secure import secure_context
from train.fleet.write import messages_of
from warehouse_env.errors import ConfigError, WarehouseError


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where certificates lie: of a plant's authority, of another one, and files that are none."""
    folder = tmp_path_factory.mktemp("certificates")
    plant = Authority(folder, "plant")
    plant.sign("broker", "DNS:localhost,IP:127.0.0.1")
    plant.sign("elsewhere", "DNS:elsewhere")
    plant.sign("old", "DNS:localhost", days=-1)
    plant.sign("client", "DNS:client")
    plant.sign("expired", "DNS:client", days=-1)
    Authority(folder, "stranger").sign("unknown", "DNS:client")
    (folder / "empty.pem").write_text("")
    (folder / "words.key").write_text("no key")
    return folder


@pytest.fixture(scope="module")
def brokers(folder: Path) -> Iterator[Any]:
    """amqtt at ports that let in anybody: plain, and over TLS with several certificates."""
    shown = {"tls": "broker", "mutual": "broker", "elsewhere": "elsewhere", "old": "old"}
    listeners = {"default": {}, **{name: secured(folder, certificate) for name, certificate in shown.items()}}
    listeners["mutual"]["cafile"] = str(folder / "plant.pem")
    with running(listeners, ANONYMOUS) as made:
        yield made


@pytest.fixture(scope="module")
def guarded(folder: Path) -> Iterator[Any]:
    """amqtt that asks for a client's certificate, and for a password."""
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


def test_all_is_heard_over_tls_with_certificates_and_a_password(
    guarded: Any, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(PASSWORD, "secret")
    context = secure_context(folder / "plant.pem", folder / "client.pem", folder / "client.key")
    broker, messages = Broker("localhost", port_of(guarded), "dispatcher", context), list(messages_of(story(), NAMES))
    with ThreadPoolExecutor() as pool:
        future = pool.submit(hear_broker, broker, "uagv", tmp_path, 5.0, None)
        until(lambda: "uagv/+/+/+/state" in guarded._subscriptions)
        assert publish(broker, messages, NAMES, ["00000"], 40.0).messages == len(messages)
        heard: Heard = future.result(10)
    assert (heard.why, heard.stopped) == ("all vehicles are offline", None)
    assert [entry["payload"] for entry in lines(tmp_path / "messages.jsonl")] == [one.payload for one in messages]
    assert check_log(tmp_path).total == 0


@pytest.mark.parametrize(
    ("user", "password", "says"),
    [
        (None, None, "lets nobody in without a user; name one with --user"),
        ("dispatcher", None, "refuses user 'dispatcher' without a password; put it into WAREHOUSE_MQTT_PASSWORD"),
        ("dispatcher", "wrong", "refuses user 'dispatcher' with the password in WAREHOUSE_MQTT_PASSWORD"),
        ("nobody", "secret", "refuses user 'nobody' with the password in WAREHOUSE_MQTT_PASSWORD"),
    ],
)
def test_a_wrong_user_is_told(
    user: str | None, password: str | None, says: str, guarded: Any, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(PASSWORD, raising=False)
    if password is not None:
        monkeypatch.setenv(PASSWORD, password)
    context = secure_context(folder / "plant.pem", folder / "client.pem", folder / "client.key")
    with pytest.raises(WarehouseError, match=says):
        greet(Broker("localhost", port_of(guarded), user, context))


def words(options: str, folder: Path) -> list[str]:
    """Return options as words, names of files as those in the folder."""
    return [str(folder / word) if "." in word else word for word in options.split()]


@pytest.mark.parametrize(
    ("port", "options", "says"),
    [
        ("tls", "--cafile plant.pem", "no vehicle said anything"),
        ("mutual", "--cafile plant.pem --cert client.pem --key client.key", "no vehicle said anything"),
        ("tls", "", "hangs up without an answer; if it speaks TLS at this port, say --tls or name its --cafile"),
        ("tls", "--tls", "is signed by nobody that is trusted; name its authority's file with --cafile"),
        ("tls", "--cafile stranger.pem", "is signed by nobody that is trusted"),
        ("elsewhere", "--cafile plant.pem", "is for another host; name the broker as its certificate does"),
        ("old", "--cafile plant.pem", "has expired"),
        ("mutual", "--cafile plant.pem", "may ask for a client's certificate, or for another one: --cert and --key"),
        ("tls", "--cafile none.pem", "none.pem does not exist"),
        ("tls", "--cafile .", "must be a regular file, not a folder"),
        ("tls", "--cafile empty.pem", "holds no certificate in PEM format"),
        ("tls", "--cafile plant.pem --cert client.pem", "--cert and --key go together"),
        ("tls", "--key client.key", "--cert and --key go together"),
        ("tls", "--cert client.key --key client.key", "client.key holds no certificate in PEM format"),
        ("tls", "--cert client.pem --key words.key", "words.key holds no private key in PEM format"),
        ("tls", "--cert client.pem --key unknown.key", "unknown.key is not the key of --cert"),
    ],
)  # fmt: skip
def test_who_is_not_let_in_is_told_why_in_a_sentence(
    port: str, options: str, says: str, brokers: Any, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["fleet", "--listen", f"localhost:{port_of(brokers, port)}", "--layout", "open", "--out", str(tmp_path)]
    assert main([*command, "--seconds", "0.1", *words(options, folder)]) == 2
    error = [line for line in capsys.readouterr().err.splitlines() if line.startswith("warehouse: ")]
    assert len(error) == 1
    assert says in error[0]


@pytest.mark.parametrize(
    ("name", "says"),
    [
        (None, "asks for a client's certificate; name one with --cert and --key"),
        ("unknown", r"refuses the client's certificate \(unknown ca\); name one that it trusts"),
        ("expired", r"refuses the client's certificate \(certificate expired\)"),
    ],
)
def test_what_a_broker_has_against_a_certificate_is_told(name: str | None, says: str, folder: Path) -> None:
    """amqtt hangs up without a word; brokers in C say why, if one only listens."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(folder / "broker.pem", folder / "broker.key")
    context.load_verify_locations(folder / "plant.pem")
    context.verify_mode = ssl.CERT_REQUIRED
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            with contextlib.suppress(OSError):  # of the server that is closed
                while True:
                    line = server.accept()[0]
                    with contextlib.suppress(ssl.SSLError), line:
                        context.wrap_socket(line, server_side=True)

        threading.Thread(target=serve, daemon=True).start()
        files = (None, None) if name is None else (folder / f"{name}.pem", folder / f"{name}.key")
        with pytest.raises(WarehouseError, match=says):
            greet(Broker("127.0.0.1", server.getsockname()[1], context=secure_context(folder / "plant.pem", *files)))


def test_a_broker_that_speaks_no_tls_is_told(brokers: Any, folder: Path) -> None:
    secure = secure_context(folder / "plant.pem", None, None)
    with pytest.raises(WarehouseError, match="does not answer in TLS at this port; name the port where it does"):
        greet(Broker("localhost", port_of(brokers), context=secure, timeout=0.2))  # amqtt waits for more


def test_a_key_with_a_passphrase_is_said_and_nobody_is_asked_for_it(folder: Path) -> None:
    locked = folder / "locked.key"
    locked.write_text(LOCKED)
    with pytest.raises(ConfigError, match="has a passphrase; write one without: openssl pkey"):
        secure_context(None, folder / "client.pem", locked)


# Nobody's key, whose passphrase is "x": openssl genpkey -algorithm ed25519 -aes128 -pass pass:x
LOCKED = """-----BEGIN ENCRYPTED PRIVATE KEY-----
MIGbMFcGCSqGSIb3DQEFDTBKMCkGCSqGSIb3DQEFDDAcBAj7lu4rQQYNLQICCAAw
DAYIKoZIhvcNAgkFADAdBglghkgBZQMEAQIEENFJrZB2jpb/q1FkEX5jxNMEQERo
e36w86YjlE/aYTySBPGnfuGG3iurj5KFWtjApQnlJ8NcS/q7rKEdq4pQbgWkuJHr
urdtyheFWDWN1QqhnmI=
-----END ENCRYPTED PRIVATE KEY-----
"""


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (b"\x15\x03\x01\x00\x02\x02\x46", "speaks TLS at this port; say --tls"),
        (b"HTTP/1.1 400 Bad Request\r\n", "is no broker of MQTT"),
        (b"\x20\x02", "is no broker of MQTT"),
        (b"\x20\x02\x00\x03", "takes no clients of MQTT 3.1.1 now"),
        (b"", "hangs up without an answer; if it speaks TLS at this port, say --tls"),
    ],
)
def test_other_answers_are_told(answer: bytes, says: str) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve() -> None:
            line = server.accept()[0]
            line.recv(1000)
            line.sendall(answer)
            line.close()

        threading.Thread(target=serve, daemon=True).start()
        with pytest.raises(WarehouseError, match=says):
            greet(Broker("127.0.0.1", server.getsockname()[1]))
