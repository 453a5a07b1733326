"""An MQTT broker: its address, TLS settings, and why a connection failed. Needs the package aiomqtt."""

from __future__ import annotations

import asyncio
import importlib
import os
import re
import ssl
from pathlib import Path
from typing import Any, NamedTuple

from warehouse_env.errors import ConfigError, WarehouseError, shown
from warehouse_env.files import path_of, read_bytes

PORT, SECURE_PORT = 1883, 8883
PASSWORD = "WAREHOUSE_MQTT_PASSWORD"
"""Name of the environment variable that holds the password."""
TIMEOUT = 10.0  # [s] to wait for an answer of the broker
KEEP_ALIVE = 15  # [s] without traffic before the client pings the broker
_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?")
_LARGEST_FILE = 4_000_000  # [bytes], of certificates
_REFUSED = (134, 135)  # MQTT reason codes: bad user name or password, not authorized


class Broker(NamedTuple):
    """Where a broker is, and how to connect to it."""

    host: str
    port: int
    user: str | None = None
    context: ssl.SSLContext | None = None  # None: no TLS
    timeout: float = TIMEOUT

    @property
    def name(self) -> str:
        """The address as HOST:PORT."""
        return f"{self.host}:{self.port}"

    def client(self, **options: Any) -> Any:
        """Return a client to be entered; WarehouseError if aiomqtt is missing."""
        return package().Client(
            self.host, self.port, username=self.user, password=os.environ.get(PASSWORD), timeout=self.timeout,
            keepalive=KEEP_ALIVE, tls_context=self.context, **options,
        )  # fmt: skip


def package() -> Any:
    """Return the module aiomqtt; WarehouseError if it is missing."""
    try:
        return importlib.import_module("aiomqtt")
    except ImportError:
        raise WarehouseError("MQTT needs the package 'aiomqtt'; pip install \"warehouse-env[fleet]\"") from None


def broker_of(text: str, user: str | None = None, context: ssl.SSLContext | None = None) -> Broker:
    """Return the broker named by HOST or HOST:PORT; ConfigError if `text` is neither."""
    found = _ADDRESS.fullmatch(text)
    port = int(found[2] or (PORT if context is None else SECURE_PORT)) if found else 0
    if found is None or not 0 < port < 65536 or len(found[1]) > 253:
        raise ConfigError(f"{shown(text)} is no broker; name it as HOST or HOST:PORT")
    return Broker(found[1].strip("[]"), port, user, context)


def secure_context(authority: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    """Return the TLS settings; ConfigError for unsuitable files.

    authority: certificates to trust (None: those of this machine). certificate, key: the client's own.
    """
    if (certificate is None) != (key is None):
        raise ConfigError("--cert and --key go together: a client's certificate, and its private key")
    for option, path in (("--cafile", authority), ("--cert", certificate), ("--key", key)):
        if path is not None:
            read_bytes(path, option, _LARGEST_FILE, ConfigError)
    try:
        context = ssl.create_default_context(cafile=None if authority is None else path_of(authority))
    except ssl.SSLError:
        raise ConfigError(f"--cafile {authority} holds no certificate in PEM format") from None
    if authority is not None:
        # Python 3.13 is stricter than brokers and their other clients: certificates of small authorities fail it.
        context.verify_flags &= ~ssl.VERIFY_X509_STRICT
    if certificate is not None and key is not None:
        _add_own(context, certificate, key)
    return context


def _add_own(context: ssl.SSLContext, certificate: Path, key: Path) -> None:
    """Add the client's certificate, which the context shows to brokers that ask for one."""

    def no_passphrase() -> str:
        raise ConfigError(f"--key {key} has a passphrase; write one without: openssl pkey -in {key} -out plain.key")

    try:
        context.load_cert_chain(path_of(certificate), path_of(key), password=no_passphrase)
    except ssl.SSLError as error:
        what = "do not match" if "MISMATCH" in (error.reason or "") else "must be a certificate and a key in PEM format"
        raise ConfigError(f"--cert {certificate} and --key {key} {what}") from None


def hush() -> None:
    """Print nothing about closed connections: the first error raised reports them."""
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)


def reason(error: Exception) -> str:
    """Return the text of a client's error, shortened."""
    cause = error.__cause__ or error.__context__ or error
    said = getattr(cause, "strerror", None) or str(error) or str(cause)
    return " ".join(said.split())[:200] or type(error).__name__


def not_connected(broker: Broker, error: Exception) -> WarehouseError:
    """Return the error for a connection that could not be made: what is wrong, and what to do."""
    name, cause = f"broker {broker.name}", error.__context__
    if getattr(getattr(error, "rc", None), "value", None) in _REFUSED:
        who = "clients without a user" if broker.user is None else f"user {shown(broker.user)}"
        return WarehouseError(f"{name} refuses {who}; check --user and the password in {PASSWORD}")
    if isinstance(cause, ssl.SSLCertVerificationError):
        return WarehouseError(
            f"the certificate of {name} is not trusted ({cause.verify_message}); name its authority's file with "
            "--cafile, and the broker as its certificate does"
        )
    if isinstance(cause, ssl.SSLError):
        return WarehouseError(f"{name} does not answer in TLS at this port ({reason(error)}); name its TLS port")
    if isinstance(cause, TimeoutError):
        return WarehouseError(
            f"{name} does not answer: check host and port; a TLS port needs --tls or --cafile, any other neither, and "
            "some brokers need --cert and --key"
        )
    return WarehouseError(f"{name} cannot be reached: {reason(error)}")
