"""The address by which people reach a server: the values of ``Host`` and ``Origin`` that are answered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from truepose.errors import DataError

_LOCAL: Final = ("127.0.0.1", "localhost", "[::1]")
_PORTS: Final = {"http": 80, "https": 443}


@dataclass(frozen=True)
class Address:
    """A public address.

    Attributes
    ----------
    scheme : str
        ``http`` or ``https``.
    host : str
        The name, or the IP address.
    port : int
        The port.
    """

    scheme: str
    host: str
    port: int

    @classmethod
    def of(cls, url: str | None, host: str, port: int) -> Address:
        """Return the address of ``--url``, or that which the server is bound to.

        Raises
        ------
        DataError
            If the URL has another form, or is missing while the server listens on all addresses.
        """
        if url is None:
            if host in ("0.0.0.0", "::", ""):
                raise DataError(f"--host {host} listens on all addresses; name the one that people open with --url")
            return cls("http", f"[{host}]" if ":" in host else host, port)
        try:
            parts = urlsplit(url)
            given = parts.port
        except ValueError:
            parts, given = urlsplit(""), None
        plain = parts.path in ("", "/") and not (parts.query or parts.fragment or "@" in parts.netloc)
        if parts.scheme not in _PORTS or not parts.hostname or not plain:
            raise DataError(f"--url {url!r} must be an address such as https://truepose.example, without a path")
        name = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        return cls(parts.scheme, name, given or _PORTS[parts.scheme])

    @property
    def local(self) -> bool:
        """Whether only this machine reaches it."""
        return self.host in _LOCAL

    @property
    def in_clear(self) -> bool:
        """Whether requests come over a network without TLS."""
        return self.scheme == "http" and not self.local

    @property
    def hosts(self) -> frozenset[str]:
        """The values of the header ``Host``."""
        names = _LOCAL if self.local else (self.host,)
        bare = names if self.port == _PORTS[self.scheme] else ()
        return frozenset({f"{name}:{self.port}" for name in names} | set(bare))

    @property
    def origins(self) -> frozenset[str]:
        """The values of the header ``Origin``."""
        return frozenset(f"{self.scheme}://{host}" for host in self.hosts)

    @property
    def url(self) -> str:
        """The address to open."""
        port = "" if self.port == _PORTS[self.scheme] else f":{self.port}"
        return f"{self.scheme}://{self.host}{port}/"
