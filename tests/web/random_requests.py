"""Requests that no page sends: random values for every endpoint of the OpenAPI document."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any, Final
from urllib.parse import quote

from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

NUMBERS: Final = st.one_of(
    st.sampled_from([0, -1, 1, 2, 10, 2**31, 2**63, -(2**64), 10**30, 10**400]),
    st.integers(-1000, 1000),
    st.sampled_from([0.5, -0.0, 1e-320, 1e308, float("nan"), float("inf"), float("-inf")]),
    st.floats(),
)
TEXTS: Final = st.one_of(
    st.sampled_from(["", " ", "\0", "..", "../..", "/etc/passwd", "a\nb", "<b>", "\ud800", "ﬁ", "İ", "x" * 3000, "{}"]),
    st.sampled_from(["a\x85b", "C:\\a", "con", "%00", "--out=x", "@file", "1e999", "nan", "٣", "9" * 5000]),
    st.text(max_size=20),
)
SCALARS: Final = st.one_of(st.none(), st.booleans(), NUMBERS, TEXTS)
JUNK: Final = st.recursive(
    SCALARS, lambda one: st.one_of(st.lists(one, max_size=4), st.dictionaries(TEXTS, one, max_size=3)), max_leaves=8
)
BODIES: Final = st.one_of(
    st.sampled_from([b"", b" ", b"{", b"null", b"[]", b"\xff\xfe{\x00}\x00", b'{"a":1,"a":2}', b"\x00", b'"\\ud800"']),
    st.sampled_from([b"[" * 100_000, b'{"a":' * 50_000, b"1e999999", b"9" * 10_000, b"NaN", b"-"]),
    st.binary(max_size=40),
)
"""Bodies that are no JSON, or hardly any."""


class Contract:
    """The OpenAPI document of an application, and values that it knows.

    Parameters
    ----------
    document : dict
        The document.
    known : mapping of str to sequence of str
        The ids that exist, by the names of parameters and keys.
    """

    def __init__(self, document: dict[str, Any], known: Mapping[str, Sequence[str]]) -> None:
        self._document, self._known = document, known
        self._ids = [one for ids in known.values() for one in ids]

    def operations(self) -> list[tuple[str, str]]:
        """Return method and path of all endpoints."""
        return [(method, path) for path, ways in self._document["paths"].items() for method in ways]

    def request(self, draw: DrawFn, method: str, path: str) -> dict[str, Any]:
        """Return the arguments of a random request."""
        operation = self._document["paths"][path][method]
        query, headers = [], {}
        for one in operation.get("parameters", []):
            name = one["name"]
            if one["in"] == "path":
                room = path.partition(f"/{{{name}}}")[0].rpartition("/")[2]
                ids = st.sampled_from(list(self._known.get(room) or self._known.get(name) or self._ids))
                value = draw(st.integers(0, 9).flatmap(lambda n, ids=ids: TEXTS if n == 0 else ids))
                path = path.replace(f"{{{name}}}", value.replace("/", "%2F"))
                continue
            value = draw(self._value(one.get("schema", {}), name))
            if one["in"] == "query" and draw(st.booleans()):
                query += [(one["name"], _plain(item)) for item in (value if isinstance(value, list) else [value])]
            elif one["in"] == "header" and draw(st.booleans()):
                headers[one["name"]] = _plain(value).encode("ascii", "ignore").decode().translate(_CONTROLS) or "*"
        body = self._body(draw, operation.get("requestBody", {}).get("content", {}))
        headers |= body_of(body)
        return {"method": method, "url": _encoded(path), "params": query, "headers": headers, **body}

    def _body(self, draw: DrawFn, content: Mapping[str, Any]) -> dict[str, Any]:
        if "multipart/form-data" in content:
            schema = self._resolved(content["multipart/form-data"]["schema"])
            fields = {name: draw(self._value(one, name)) for name, one in schema["properties"].items()}
            fields["options"] = draw(st.one_of(JUNK, st.just({}))) if "options" not in fields else fields["options"]
            files = [
                (name, (_text(draw(_NAMES)), draw(_CONTENTS)))
                for name in fields
                if "file" in name or name in ("readings", "before")
                for _ in range(draw(st.integers(0, 2)))
            ]
            sent = {name: _text(value) for name, value in fields.items() if name not in dict(files)}
            return {"data": sent, "files": files or [("other", ("", b""))]}
        if "application/json" not in content:
            return {}
        if draw(st.integers(0, 5)) == 0:
            return {"content": draw(BODIES)}
        value = draw(self._value(content["application/json"]["schema"], ""))
        return {"content": json.dumps(value).encode()}

    def _resolved(self, schema: dict[str, Any]) -> dict[str, Any]:
        while "$ref" in schema:
            schema = self._document["components"]["schemas"][schema["$ref"].rpartition("/")[2]]
        return schema

    def _value(self, schema: dict[str, Any], name: str, depth: int = 0) -> SearchStrategy[Any]:
        """Return values of a schema; now and then others."""
        fitting = self._fitting(self._resolved(schema), name, depth)
        return st.integers(0, 9).flatmap(lambda n: JUNK if n == 0 else fitting)

    def _fitting(self, schema: dict[str, Any], name: str, depth: int) -> SearchStrategy[Any]:
        if depth > 5:
            return st.none()
        if "anyOf" in schema:
            return st.one_of([self._value(one, name, depth + 1) for one in schema["anyOf"]])
        if "enum" in schema or "const" in schema:
            return st.sampled_from(schema.get("enum", [schema.get("const")]))
        kind = schema.get("type")
        if kind == "object":
            return self._object(schema, depth)
        if kind == "array":
            return st.lists(self._value(schema.get("items", {}), name, depth + 1), max_size=4)
        if kind == "boolean":
            return st.booleans()
        if kind in ("integer", "number"):
            low, high = schema.get("minimum", -10), schema.get("maximum", 100)
            inside = st.integers(int(low), max(int(low), min(int(high), int(low) + 20)))
            return st.one_of(inside, st.just(high), NUMBERS)
        if kind == "string":
            ids = list(self._known.get(name, ())) or self._ids
            return st.one_of(st.sampled_from(ids), st.sampled_from(ids), TEXTS)
        return JUNK

    def _object(self, schema: dict[str, Any], depth: int) -> SearchStrategy[dict[str, Any]]:
        needed, others = {}, {}
        for name, one in schema.get("properties", {}).items():
            (needed if name in schema.get("required", ()) else others)[name] = self._value(one, name, depth + 1)
        if isinstance(more := schema.get("additionalProperties"), dict):
            return st.dictionaries(st.one_of(st.integers(-1, 50).map(str), TEXTS), self._value(more, "", depth + 1))
        return st.fixed_dictionaries(needed, optional=others)


_CONTROLS: Final = dict.fromkeys(range(32)) | {127: None}
_NAMES: Final = st.one_of(
    st.sampled_from(["a.csv", "a.src", "a.zip", "a.xlsx", "a.urdf", "../a.toml", "con", "."]), TEXTS
)
_CONTENTS: Final = st.one_of(
    st.sampled_from([b"", b"PK\x03\x04", b"x,y,z\n1,2,3\n", b"DEF a( )\nLIN {X 1}\nEND\n", b"\xff\xfea\x00"]),
    st.sampled_from([b"x_meas_mm,y_meas_mm,z_meas_mm,q1_deg\nnan,1e999,-,9\n", b"\x00" * 99, b"nan;inf;1\n"]),
    st.sampled_from([b"<robot>", b"<robot/>"]),
    st.binary(max_size=200),
)


def body_of(body: Mapping[str, Any]) -> dict[str, str]:
    """Return the headers of a body."""
    return {"Content-Type": "application/json"} if "content" in body else {}


def _plain(value: Any) -> str:
    return str(value).encode("utf-8", "replace").decode()


def _text(value: Any) -> str:
    """Return a value as a field of a form."""
    return (value if isinstance(value, str) else json.dumps(value)).encode("utf-8", "replace").decode()


def _encoded(path: str) -> str:
    return quote(path.encode("utf-8", "surrogatepass"), safe="/%")
