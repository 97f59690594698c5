"""The OpenAPI document, and a page made from it that needs nothing from elsewhere."""

from __future__ import annotations

import json
from html import escape
from typing import Any

from fastapi import FastAPI
from fastapi.openapi.utils import get_openapi
from fastapi.responses import HTMLResponse

from api.errors import PROBLEM_JSON
from api.schemas import Problem

Node = dict[str, Any]
POLICY = "default-src 'none'; style-src 'unsafe-inline'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
STYLE = """body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#1a1a1a}
code,pre{font:13px/1.5 ui-monospace,monospace}pre{background:#f5f5f3;padding:.8rem;overflow:auto}
summary{cursor:pointer;padding:.3rem 0}table{border-collapse:collapse}td{padding:.1rem .8rem .1rem 0;vertical-align:top}
b{display:inline-block;min-width:4rem}@media(prefers-color-scheme:dark){body{background:#161616;color:#e6e6e6}
pre{background:#222}}"""


def install(app: FastAPI) -> None:
    """The document at /openapi.json, the page at /docs."""
    app.openapi = lambda: document(app)  # pyright: ignore[reportAttributeAccessIssue]

    @app.get("/docs", include_in_schema=False)
    def docs() -> HTMLResponse:
        """Every route, as a page."""
        return HTMLResponse(page(app.openapi()), headers={"Content-Security-Policy": POLICY})


def document(app: FastAPI) -> Node:
    """What FastAPI makes, with problems as what they are: application/problem+json."""
    if app.openapi_schema is None:
        made = get_openapi(title=app.title, version=app.version, description=app.description, routes=app.routes)
        made["components"]["schemas"] |= {"Problem": Problem.model_json_schema()}
        for item in made["paths"].values():
            for operation in item.values():
                _mark_problems(operation["responses"])
        app.openapi_schema = made
    return app.openapi_schema


def _mark_problems(responses: Node) -> None:
    for answer in responses.values():
        schema = answer.get("content", {}).get("application/json", {}).get("schema", {})
        if schema.get("$ref", "").endswith(("/Problem", "/HTTPValidationError")):
            answer["content"] = {PROBLEM_JSON: {"schema": {"$ref": "#/components/schemas/Problem"}}}


def page(document: Node) -> str:
    """The document as HTML."""
    operations = [
        _operation(method, path, operation)
        for path, item in document["paths"].items()
        for method, operation in item.items()
    ]
    schemas = [
        f"<details id='{escape(name)}'><summary><code>{escape(name)}</code></summary><p>{_prose(schema)}</p>"
        f"<pre>{escape(json.dumps(schema.get('properties', schema), indent=1, ensure_ascii=False))}</pre></details>"
        for name, schema in sorted(document["components"]["schemas"].items())
    ]
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(document['info']['title'])}</title>"
        f"<style>{STYLE}</style><h1>{escape(document['info']['title'])}</h1>"
        f"<p>{escape(document['info'].get('description', ''))} "
        "For programs: <a href=/openapi.json>/openapi.json</a>.</p>"
        f"{''.join(operations)}<h2>Bodies and answers</h2>{''.join(schemas)}</html>"
    )


def _operation(method: str, path: str, operation: Node) -> str:
    parameters = "".join(
        f"<tr><td><code>{escape(each['name'])}</code><td>{each['in']}<td>{_type(each['schema'])}<td>{_prose(each)}"
        for each in operation.get("parameters", [])
    )
    body = "".join(
        f"<tr><td>body<td><code>{escape(kind)}</code><td>{_type(content.get('schema', {}))}<td>"
        for kind, content in operation.get("requestBody", {}).get("content", {}).items()
    )
    answers = "".join(
        f"<tr><td>{status}<td>{', '.join(map(escape, answer.get('content', {})))}"
        f"<td>{', '.join(_type(c.get('schema', {})) for c in answer.get('content', {}).values())}<td>{_prose(answer)}"
        for status, answer in operation["responses"].items()
    )
    return (
        f"<details><summary><b>{method.upper()}</b><code>{escape(path)}</code></summary>"
        f"<p>{_prose(operation)}</p><table>{parameters}{body}</table><table>{answers}</table></details>"
    )


def _prose(node: Node) -> str:
    return escape(str(node.get("description") or node.get("summary") or "")).replace("\n\n", "</p><p>")


def _type(schema: Node) -> str:
    if "$ref" in schema:
        name = escape(schema["$ref"].rpartition("/")[2])
        return f"<a href='#{name}'>{name}</a>"
    if "anyOf" in schema:
        return " or ".join(_type(each) for each in schema["anyOf"])
    return escape(str(schema.get("format") or schema.get("type", "")))
