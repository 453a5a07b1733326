"""A broker of MQTT: where it is, and how to speak to it. Needs the package aiomqtt."""

from __future__ import annotations

import asyncio
import importlib
import os
import re
import ssl
from typing import Any, NamedTuple

from warehouse_env.errors import ConfigError, WarehouseError, shown

PORT, SECURE_PORT = 1883, 8883
PASSWORD = "WAREHOUSE_MQTT_PASSWORD"
"""Name of the variable of the environment that holds the password."""
TIMEOUT = 10.0  # [s] for which a broker may take for an answer
KEEP_ALIVE = 15  # [s] after which a broker without a word is asked whether it is there
_ADDRESS = re.compile(r"(\[[0-9A-Fa-f:.%]+\]|[^\s:/\[\]]+)(?::(\d{1,5}))?")


class Broker(NamedTuple):
    """Where a broker is, and how to speak to it."""

    host: str
    port: int
    user: str | None = None
    context: ssl.SSLContext | None = None  # of TLS; without one all is sent as it is
    timeout: float = TIMEOUT

    @property
    def name(self) -> str:
        """As it is typed."""
        return f"{self.host}:{self.port}"

    @property
    def password(self) -> str | None:
        """The user's, if there is any."""
        return os.environ.get(PASSWORD)

    def client(self, **options: Any) -> Any:
        """Return a client, to be entered; WarehouseError where aiomqtt is missing."""
        return package().Client(
            self.host, self.port, username=self.user, password=self.password, timeout=self.timeout,
            keepalive=KEEP_ALIVE, tls_context=self.context, **options,
        )  # fmt: skip


def package() -> Any:
    """Return the module aiomqtt; WarehouseError where it is missing."""
    try:
        return importlib.import_module("aiomqtt")
    except ImportError:
        raise WarehouseError("MQTT needs the package 'aiomqtt'; pip install \"warehouse-env[fleet]\"") from None


def broker_of(text: str, user: str | None = None, context: ssl.SSLContext | None = None) -> Broker:
    """Return the broker of HOST or HOST:PORT; ConfigError for what is neither."""
    found = _ADDRESS.fullmatch(text)
    port = int(found[2] or (PORT if context is None else SECURE_PORT)) if found else 0
    if found is None or not 0 < port < 65536 or len(found[1]) > 253:
        raise ConfigError(f"{shown(text)} is no broker; name it as HOST or HOST:PORT")
    return Broker(found[1].strip("[]"), port, user, context)


def hush() -> None:
    """Let nothing be printed of connections that ended: the first error that is raised says it."""
    asyncio.get_running_loop().set_exception_handler(lambda loop, context: None)


def reason(error: Exception) -> str:
    """Return what a client's error says, in a few words."""
    inner = error.__cause__ if not str(error) and error.__cause__ is not None else error
    return " ".join(str(inner).split())[:200] or type(error).__name__
