"""TLS: whom to trust and who one is, out of files in PEM format; what is wrong with them is said."""

from __future__ import annotations

import ssl
from pathlib import Path

from warehouse_env.errors import ConfigError
from warehouse_env.files import path_of, read_bytes

_LARGEST_FILE = 4_000_000  # [bytes]


def secure_context(authority: Path | None, certificate: Path | None, key: Path | None) -> ssl.SSLContext:
    """Return how to speak TLS; ConfigError for files that are not what their options say.

    authority: certificates of who is trusted, those of this machine if None. certificate, key: the client's own, for
    brokers that ask for them.
    """
    if (certificate is None) != (key is None):
        raise ConfigError("--cert and --key go together: a client's certificate, and its private key")
    if authority is None:
        context = ssl.create_default_context()
    else:
        context = ssl.create_default_context(cafile=_with_certificate("--cafile", authority))
        # Python 3.13 asks more of certificates than brokers and their other clients do: small authorities fail it.
        context.verify_flags &= ~ssl.VERIFY_X509_STRICT
    if certificate is not None and key is not None:
        _show(context, certificate, key)
    return context


def _show(context: ssl.SSLContext, certificate: Path, key: Path) -> None:
    """Have a context show the client's own certificate to who asks for it."""
    shown, secret = _with_certificate("--cert", certificate), _readable("--key", key)

    def ask() -> str:
        raise ConfigError(f"--key {key} has a passphrase; write one without: openssl pkey -in {key} -out plain.key")

    try:
        context.load_cert_chain(shown, secret, password=ask)
    except ssl.SSLError as error:
        if "MISMATCH" in (error.reason or ""):
            raise ConfigError(f"--key {key} is not the key of --cert {certificate}; name the two that match") from None
        raise ConfigError(f"--key {key} holds no private key in PEM format (-----BEGIN PRIVATE KEY-----)") from None


def _with_certificate(option: str, given: Path) -> Path:
    """Return the path of a file that holds a certificate at least."""
    path = _readable(option, given)
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(path)
    except ssl.SSLError:
        form = "in PEM format (-----BEGIN CERTIFICATE-----)"
        raise ConfigError(
            f"{option} {given} holds no certificate {form}; of DER it is made by openssl x509 -inform der"
        ) from None
    return path


def _readable(option: str, given: Path) -> Path:
    """Return the path of a file that can be read."""
    read_bytes(given, option, _LARGEST_FILE, ConfigError)
    return path_of(given)
