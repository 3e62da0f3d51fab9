"""A small OpenID Connect provider on this machine, which signs what a test asks for."""

from __future__ import annotations

import base64
import hashlib
import json
import secrets
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

from joserfc import jwt
from joserfc.jwk import RSAKey

CLIENT, SECRET = "truepose-plant", "a secret of the client"


@dataclass
class Grant:
    """What the provider signs for a code."""

    challenge: str
    claims: dict[str, Any]
    algorithm: str = "RS256"
    foreign_key: bool = False
    kid: str = "first"


@dataclass
class SmallProvider:
    """A provider; `document` and `grants` may be changed by a test."""

    issuer: str
    key: RSAKey = field(default_factory=lambda: RSAKey.generate_key(2048, {"kid": "first"}))
    grants: dict[str, Grant] = field(default_factory=dict)
    document: dict[str, Any] = field(default_factory=dict)
    subject: str = ""
    """Who is logged in at the page of the provider; nobody may be."""

    @classmethod
    @contextmanager
    def started(cls) -> Iterator[SmallProvider]:
        """Serve a provider on a free port."""

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                path = self.path
                if path.startswith("/page?"):
                    self.send_response(302)
                    self.send_header("location", provider.page(path))
                    self.end_headers()
                    return
                known = {"/.well-known/openid-configuration": provider.document, "/keys": provider.public()}
                self._answer(200 if path in known else 404, known.get(path, {}))

            def do_POST(self) -> None:
                form = parse_qs(self.rfile.read(int(self.headers["content-length"])).decode())
                self._answer(*provider.token(form, self.headers.get("authorization", "")))

            def log_message(self, *_: Any) -> None:
                """Print nothing."""

            def _answer(self, status: int, found: dict[str, Any]) -> None:
                self.send_response(status)
                self.send_header("content-type", "application/json")
                self.end_headers()
                self.wfile.write(json.dumps(found).encode())

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        provider = cls(f"http://127.0.0.1:{server.server_address[1]}")
        pages = {"authorization_endpoint": "page", "token_endpoint": "token", "jwks_uri": "keys"}
        provider.document = {"issuer": provider.issuer} | {
            name: f"{provider.issuer}/{page}" for name, page in pages.items()
        }
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        try:
            yield provider
        finally:
            server.shutdown()
            server.server_close()
            thread.join()

    def page(self, url: str) -> str:
        """Return where the page of the provider sends the browser back to."""
        asked = {name: values[0] for name, values in parse_qs(urlsplit(url).query).items()}
        answer = {"code": self.grant(url, self.subject)} if self.subject else {"error": "access_denied"}
        return f"{asked['redirect_uri']}?{urlencode({'state': asked['state'], **answer})}"

    def public(self) -> dict[str, Any]:
        """Return the public key."""
        return {"keys": [self.key.as_dict(private=False)]}

    def grant(
        self, url: str, subject: str, *, algorithm: str = "RS256", foreign_key: bool = False, **claims: Any
    ) -> str:
        """Log somebody in at the page of an address, and return the code; `claims` replace the right ones."""
        asked = {name: values[0] for name, values in parse_qs(urlsplit(url).query).items()}
        assert asked["code_challenge_method"] == "S256"
        assert asked["client_id"] == CLIENT
        now = int(time.time())
        right = {
            "iss": self.issuer,
            "aud": CLIENT,
            "sub": subject,
            "nonce": asked["nonce"],
            "iat": now,
            "exp": now + 60,
        }
        code = secrets.token_urlsafe(8)
        self.grants[code] = Grant(asked["code_challenge"], {**right, **claims}, algorithm, foreign_key)
        return code

    def token(self, form: dict[str, list[str]], authorization: str) -> tuple[int, dict[str, Any]]:
        """Return the answer to a code."""
        basic = "Basic " + base64.b64encode(f"{CLIENT}:{SECRET}".encode()).decode()
        grant = self.grants.pop(form.get("code", [""])[0], None)
        verifier = hashlib.sha256(form.get("code_verifier", [""])[0].encode()).digest()
        proven = base64.urlsafe_b64encode(verifier).rstrip(b"=").decode()
        if grant is None or grant.challenge != proven or authorization != basic:
            return 400, {"error": "invalid_grant"}
        return 200, {"access_token": "x", "token_type": "Bearer", "id_token": self._signed(grant)}

    def _signed(self, grant: Grant) -> str:
        if grant.algorithm == "none":
            parts = ({"alg": "none"}, grant.claims)
            encoded = [base64.urlsafe_b64encode(json.dumps(one).encode()).rstrip(b"=").decode() for one in parts]
            return ".".join([*encoded, ""])
        key = RSAKey.generate_key(2048) if grant.foreign_key else self.key
        return jwt.encode({"alg": grant.algorithm, "kid": grant.kid}, grant.claims, key)
