"""TLS settings from PEM files: which brokers to trust, and the client's own certificate."""

from __future__ import annotations

import ssl
from pathlib import Path

from warehouse_env.errors import ConfigError
from warehouse_env.files import path_of, read_bytes

_LARGEST_FILE = 4_000_000  # [bytes]


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
