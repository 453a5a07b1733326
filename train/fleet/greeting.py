"""The first word to a broker: a client that comes and goes, to learn in a sentence why others would not be let in.

aiomqtt waits in vain where a broker hangs up before it answers, and of TLS it does not tell what went wrong.
"""

from __future__ import annotations

import socket
import ssl

from train.fleet.broker import KEEP_ALIVE, PASSWORD, Broker
from warehouse_env.errors import WarehouseError, shown

_ACCEPTED, _WRONG_USER, _FORBIDDEN = 0, 4, 5  # codes of return of MQTT 3.1.1
_ANSWER = b"\x20\x02"  # how CONNACK begins
_ALERT = b"\x15\x03"  # how an alert of TLS begins
_BYE = b"\xe0\x00"
_PAUSE = 2.0  # [s] in which a broker says what it has against a certificate
# Codes of OpenSSL (X509_V_ERR) for what is wrong with a certificate.
_NOT_YET, _EXPIRED, _OTHER_NAME, _UNKNOWN = (9,), (10,), (62, 64), (2, 18, 19, 20, 21)


def greet(broker: Broker) -> None:
    """Connect, say who one is, and leave; WarehouseError says what is wrong, and what to do."""
    with _connected(broker) as line:
        try:
            line.sendall(_hello(broker))
            with line.makefile("rb") as stream:
                answer = stream.read(4)
            if answer == _ANSWER + bytes([0, _ACCEPTED]):
                line.sendall(_BYE)
        except TimeoutError:
            raise WarehouseError(f"broker {broker.name} cannot be reached: it timed out") from None
        except OSError as error:
            if _alert(error):
                raise _unsecured(broker, error) from None
            answer = b""  # it hung up
    if not answer and broker.context is not None:
        _shake_hands(broker)
    _judge(broker, answer)


def _shake_hands(broker: Broker) -> None:
    """Connect and only listen; WarehouseError where a broker says what it has against the client's certificate.

    It says so after its side of the handshake is done, and who sends a word meanwhile loses what it said.
    """
    with _connected(broker) as line:
        line.settimeout(_PAUSE)
        try:
            line.recv(1)
        except OSError as error:
            if _alert(error):
                raise _unsecured(broker, error) from None


def _connected(broker: Broker) -> socket.socket:
    """Return a connection, over TLS if so."""
    try:
        line = socket.create_connection((broker.host, broker.port), broker.timeout)
    except (OSError, UnicodeError) as error:
        why = "it timed out" if isinstance(error, TimeoutError) else getattr(error, "strerror", None) or error
        raise WarehouseError(f"broker {broker.name} cannot be reached: {why}") from None
    if broker.context is None:
        return line
    try:
        return broker.context.wrap_socket(line, server_hostname=broker.host)
    except ssl.SSLCertVerificationError as error:
        raise _distrusted(broker, error) from None
    except OSError as error:
        raise _unsecured(broker, error) from None


def _hello(broker: Broker) -> bytes:
    """Return CONNECT of MQTT 3.1.1, of a client without a name."""
    words = [] if broker.user is None else [broker.user, *([] if broker.password is None else [broker.password])]
    flags = (0x02, 0x82, 0xC2)[len(words)]  # a clean session; a user; a password, too
    body = b"\x00\x04MQTT\x04" + bytes([flags]) + KEEP_ALIVE.to_bytes(2)
    for text in ("", *words):
        body += len(text.encode()).to_bytes(2) + text.encode()
    length, left = b"", len(body)
    while left >= 128:
        length, left = length + bytes([left % 128 + 128]), left // 128
    return b"\x10" + length + bytes([left]) + body


def _judge(broker: Broker, answer: bytes) -> None:
    """Raise WarehouseError unless the broker lets one in."""
    if answer[:2] == _ALERT:
        raise WarehouseError(f"broker {broker.name} speaks TLS at this port; say --tls, or name its --cafile")
    if not answer and broker.context is None:
        raise WarehouseError(
            f"broker {broker.name} hangs up without an answer; if it speaks TLS at this port, say --tls or name its "
            "--cafile"
        )
    if not answer:
        raise WarehouseError(
            f"broker {broker.name} hangs up without an answer; it may ask for a client's certificate, or for another "
            "one: --cert and --key"
        )
    if len(answer) < 4 or answer[:2] != _ANSWER:
        raise WarehouseError(f"what answers at {broker.name} is no broker of MQTT; name its port as HOST:PORT")
    if answer[3] in (_WRONG_USER, _FORBIDDEN):
        raise WarehouseError(f"broker {broker.name} {_refusal(broker)}")
    if answer[3] != _ACCEPTED:
        raise WarehouseError(f"broker {broker.name} takes no clients of MQTT 3.1.1 now (code {answer[3]}); try again")


def _refusal(broker: Broker) -> str:
    """Return what is wrong with a user."""
    if broker.user is None:
        return f"lets nobody in without a user; name one with --user, and put the password into {PASSWORD}"
    if broker.password is None:
        return f"refuses user {shown(broker.user)} without a password; put it into {PASSWORD}"
    return f"refuses user {shown(broker.user)} with the password in {PASSWORD}; correct one of them"


def _distrusted(broker: Broker, error: ssl.SSLCertVerificationError) -> WarehouseError:
    """Return (not raise) the error for a broker whose certificate is not taken."""
    whose, code = f"the certificate of broker {broker.name}", error.verify_code
    if code in _EXPIRED:
        return WarehouseError(f"{whose} has expired, or its authority's has; the broker needs a new one")
    if code in _NOT_YET:
        return WarehouseError(f"{whose} is not valid yet; set the clock of this machine, or of who made it")
    if code in _OTHER_NAME:
        return WarehouseError(f"{whose} is for another host; name the broker as its certificate does")
    if code in _UNKNOWN:
        return WarehouseError(f"{whose} is signed by nobody that is trusted; name its authority's file with --cafile")
    return WarehouseError(f"{whose} is not valid ({error.verify_message}); the broker needs another one")


def _alert(error: OSError) -> str:
    """Return with which alert the other side ended TLS, in words; none where it did not."""
    return (getattr(error, "reason", None) or "").partition("ALERT_")[2].replace("_", " ").lower()


def _unsecured(broker: Broker, error: OSError) -> WarehouseError:
    """Return (not raise) the error for a broker with which TLS cannot be spoken."""
    alert = _alert(error)
    if not alert:
        return WarehouseError(
            f"broker {broker.name} does not answer in TLS at this port; name the port where it does as HOST:PORT, or "
            "leave out --tls, --cafile, --cert and --key"
        )
    if alert in ("certificate required", "handshake failure"):
        return WarehouseError(f"broker {broker.name} asks for a client's certificate; name one with --cert and --key")
    if alert == "protocol version":
        return WarehouseError(f"broker {broker.name} speaks no version of TLS that is safe; it needs a newer one")
    refused = f"broker {broker.name} refuses the client's certificate ({alert})"
    return WarehouseError(f"{refused}; name one that it trusts with --cert and --key")
