"""Log-in by OpenID Connect: the code flow with state, nonce and PKCE, and the checks of what the provider signed.

It needs the extra ``truepose[oidc]``. Nothing of the provider is believed but what a key of its own document signed for
this server and for the log-in that was begun in the same browser.
"""

from __future__ import annotations

import hmac
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import urlsplit

from truepose._extras import needed
from truepose.errors import DataError, FileError, RefusedError, TrueposeError

if TYPE_CHECKING:
    from collections.abc import Iterator

    import httpx

OIDC_CALLBACK: Final = "/api/v1/login/oidc/callback"
"""The path to which the provider sends browsers back."""
PENDING_S: Final = 600.0
"""A log-in that was begun ends after this time."""
_MOST_PENDING: Final = 1000
_KEPT_S: Final = 3600.0  # the document of the provider, and its keys
_TIMEOUT_S: Final = 10.0
_LEEWAY_S: Final = 60
_ALGORITHMS: Final = ("RS256", "RS384", "RS512", "PS256", "PS384", "PS512", "ES256", "ES384", "ES512", "EdDSA")
_VARIABLE: Final = "TRUEPOSE_OIDC_"
_ENDPOINTS: Final = ("authorization_endpoint", "token_endpoint", "jwks_uri")
_LOCAL: Final = ("127.0.0.1", "localhost", "::1")


class ProviderError(TrueposeError):
    """The provider cannot be reached, or gave an answer that is no part of OpenID Connect."""


@dataclass(frozen=True)
class Settings:
    """The settings of a provider.

    Attributes
    ----------
    issuer : str
        The address of the provider, as it names itself.
    client_id, client_secret : str
        The name of this server at the provider, and its secret.
    claim : str
        The claim that is compared with the subjects of users.
    """

    issuer: str
    client_id: str
    client_secret: str
    claim: str = "sub"

    @classmethod
    def of(cls, environment: Mapping[str, str]) -> Settings | None:
        """Return the settings in variables of the environment; None if no issuer is set.

        Raises
        ------
        DataError
            If a variable is missing or refused.
        FileError
            If the file of the secret cannot be read.
        """
        given = {name: environment.get(_VARIABLE + name, "").strip() for name in ("ISSUER", "CLIENT_ID", "CLAIM")}
        if not (issuer := given["ISSUER"]):
            return None
        _check_url(issuer, f"{_VARIABLE}ISSUER")
        if not given["CLIENT_ID"]:
            raise DataError(f"{_VARIABLE}CLIENT_ID is missing; set it to the client id of this server at the provider")
        return cls(issuer, given["CLIENT_ID"], _secret(environment), given["CLAIM"] or "sub")


@dataclass(frozen=True)
class _Pending:
    browser: str
    nonce: str
    verifier: str
    began: float


@dataclass(frozen=True)
class Begun:
    """A log-in that has begun.

    Attributes
    ----------
    url : str
        The page of the provider.
    browser : str
        A secret for a cookie of the browser, which must come back with the provider's answer.
    """

    url: str
    browser: str


class Provider:
    """A provider of log-ins.

    Parameters
    ----------
    settings : Settings
        The settings.
    redirect_uri : str
        The address to which the provider sends browsers back.
    clock : callable
        A function that returns the time in seconds.

    Raises
    ------
    MissingPackageError
        If the packages of the extra are not installed.
    """

    def __init__(self, settings: Settings, redirect_uri: str, *, clock: Callable[[], float] = time.monotonic) -> None:
        with needed("log-in by OpenID Connect", "oidc", f"unset {_VARIABLE}ISSUER"):
            import authlib  # noqa: F401
            import httpx  # noqa: F401
            import joserfc  # noqa: F401
        self.settings, self.redirect_uri = settings, redirect_uri
        self._clock = clock
        self._lock = threading.Lock()
        self._pending: dict[str, _Pending] = {}
        self._document: tuple[float, dict[str, Any]] | None = None
        self._keys: tuple[float, dict[str, Any]] | None = None

    @property
    def name(self) -> str:
        """The host of the provider, for the button of the page."""
        return urlsplit(self.settings.issuer).hostname or ""

    def begin(self) -> Begun:
        """Begin a log-in.

        Raises
        ------
        ProviderError
            If the provider cannot be reached.
        """
        from authlib.common.security import generate_token
        from authlib.common.urls import add_params_to_uri
        from authlib.oauth2.rfc7636 import create_s256_code_challenge

        document = self._discovered()
        now, state = self._clock(), secrets.token_urlsafe(32)
        pending = _Pending(secrets.token_urlsafe(32), secrets.token_urlsafe(32), generate_token(64), now)
        asked = {
            "client_id": self.settings.client_id,
            "response_type": "code",
            "redirect_uri": self.redirect_uri,
            "scope": "openid" if self.settings.claim == "sub" else "openid profile email",
            "state": state,
            "nonce": pending.nonce,
            "code_challenge": create_s256_code_challenge(pending.verifier),
            "code_challenge_method": "S256",
        }
        url = add_params_to_uri(document["authorization_endpoint"], list(asked.items()))
        with self._lock:
            kept = {key: one for key, one in self._pending.items() if now - one.began < PENDING_S}
            self._pending = {**dict(list(kept.items())[-_MOST_PENDING + 1 :]), state: pending}
        return Begun(url, pending.browser)

    def finish(self, state: str, code: str, browser: str) -> str:
        """Return the subject that the provider proved; each state works once.

        Raises
        ------
        RefusedError
            If the log-in was not begun in this browser, has ended, or the provider's token is not valid.
        ProviderError
            If the provider cannot be reached.
        """
        with self._lock:
            pending = self._pending.get(state)
            if pending is None or not hmac.compare_digest(pending.browser.encode(), browser.encode()):
                raise RefusedError("this log-in was not begun in this browser, or was used already; begin again")
            del self._pending[state]
        if self._clock() - pending.began >= PENDING_S:
            raise RefusedError(f"the log-in took more than {PENDING_S / 60:.0f} min; begin again")
        return self._subject(self._token(code, pending.verifier), pending.nonce)

    def _token(self, code: str, verifier: str) -> str:
        """Exchange a code for the signed token."""
        settings = self.settings
        form = {
            "grant_type": "authorization_code",
            "code": code,
            "redirect_uri": self.redirect_uri,
            "code_verifier": verifier,
        }
        document = self._discovered()
        with self._client() as client:
            answer = client.post(
                document["token_endpoint"], data=form, auth=(settings.client_id, settings.client_secret)
            )
            if answer.status_code in (400, 401):
                raise RefusedError(f"the provider refused the code of the log-in: {answer.text[:200]}")
            answer.raise_for_status()
            found = answer.json()
        token = found.get("id_token") if isinstance(found, dict) else None
        if not isinstance(token, str):
            raise ProviderError("the provider gave no id_token; the scope openid must be permitted for this client")
        return token

    def _subject(self, token: str, nonce: str) -> str:
        """Check a token and return the value of the claim that names the user."""
        from joserfc import jwt
        from joserfc.errors import InvalidKeyIdError, JoseError

        wanted = jwt.JWTClaimsRegistry(
            leeway=_LEEWAY_S,
            iss={"essential": True, "value": self.settings.issuer},
            aud={"essential": True, "value": self.settings.client_id},
            nonce={"essential": True, "value": nonce},
            exp={"essential": True},
            iat={"essential": True},
            sub={"essential": True},
        )
        try:
            try:
                claims = self._decoded(token)
            except InvalidKeyIdError:  # the provider has changed its keys
                self._keys = None
                claims = self._decoded(token)
            wanted.validate(claims)
        except TrueposeError:
            raise
        except (JoseError, ValueError) as error:
            raise RefusedError(f"the token of the provider is not valid: {error}") from None
        self._check_party(claims)
        return self._named(claims)

    def _decoded(self, token: str) -> dict[str, Any]:
        from joserfc import jwt
        from joserfc.jwk import KeySet

        if self._keys is None or self._clock() - self._keys[0] > _KEPT_S:
            self._keys = self._clock(), self._got(self._discovered()["jwks_uri"])
        public = [key for key in self._keys[1].get("keys", []) if isinstance(key, dict) and key.get("kty") != "oct"]
        if not public:
            raise ProviderError("the provider has no public key")
        claims: dict[str, Any] = jwt.decode(
            token, KeySet.import_key_set({"keys": public}), algorithms=list(_ALGORITHMS)
        ).claims
        return claims

    def _check_party(self, claims: Mapping[str, Any]) -> None:
        """Refuse a token that was made for several, of whom another asked for it."""
        audience, party = claims["aud"], claims.get("azp")
        several = isinstance(audience, list) and len(audience) > 1
        if (several or party is not None) and party != self.settings.client_id:
            raise RefusedError("the token of the provider is not valid: another client asked for it")

    def _named(self, claims: Mapping[str, Any]) -> str:
        """Return the value of the claim that names the user."""
        claim = self.settings.claim
        value = claims.get(claim)
        if not isinstance(value, str) or not value:
            raise RefusedError(f"the token of the provider has no claim {claim!r}; see {_VARIABLE}CLAIM")
        if claim == "email" and claims.get("email_verified") is not True:
            raise RefusedError("the provider has not verified the e-mail address")
        return value

    def _discovered(self) -> dict[str, Any]:
        """Return the document of the provider, which is kept for an hour."""
        if self._document is not None and self._clock() - self._document[0] < _KEPT_S:
            return self._document[1]
        issuer = self.settings.issuer
        document = self._got(f"{issuer.rstrip('/')}/.well-known/openid-configuration")
        if document.get("issuer") != issuer:
            raise ProviderError(f"the provider names itself {document.get('issuer')!r}, but the issuer is {issuer!r}")
        for name in _ENDPOINTS:
            _check_url(str(document.get(name, "")), f"the provider's {name}")
        self._document = self._clock(), document
        return document

    def _got(self, url: str) -> dict[str, Any]:
        with self._client() as client:
            answer = client.get(url)
            answer.raise_for_status()
            found = answer.json()
        if not isinstance(found, dict):
            raise ProviderError(f"{url} is no JSON object")
        return found

    @contextmanager
    def _client(self) -> Iterator[httpx.Client]:
        """Open a client of the provider; what it cannot reach or read is a `ProviderError`."""
        import httpx

        try:
            with httpx.Client(timeout=_TIMEOUT_S, follow_redirects=False) as client:
                yield client
        except TrueposeError:
            raise
        except (httpx.HTTPError, httpx.InvalidURL, ValueError) as error:
            raise ProviderError(f"the provider {self.name} cannot be used now: {error}") from None


def _secret(environment: Mapping[str, str]) -> str:
    """Return the secret of the client, from a variable or a file."""
    name = f"{_VARIABLE}CLIENT_SECRET"
    if secret := environment.get(name, "").strip():
        return secret
    if not (file := environment.get(f"{name}_FILE", "")):
        raise DataError(f"the secret of the client is missing; set {name}, or {name}_FILE to a file with it")
    try:
        secret = Path(file).read_text("utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise FileError(file, f"cannot be read: {error}") from None
    if not secret:
        raise FileError(file, "is empty; it must hold the secret of the client")
    return secret


def _check_url(url: str, what: str) -> None:
    """Refuse an address that is not protected by TLS, unless it is on this machine."""
    try:
        parts = urlsplit(url)
    except ValueError:
        parts = urlsplit("")
    if not parts.hostname or not (parts.scheme == "https" or (parts.scheme == "http" and parts.hostname in _LOCAL)):
        raise DataError(f"{what} must be an https address, got {url!r}")
