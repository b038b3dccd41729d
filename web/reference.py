"""A readable page of the REST interface, made of its OpenAPI document: no scripts, nothing from elsewhere."""

from __future__ import annotations

import html
from typing import Any

import msgspec

_HEAD = (
    '<!doctype html><html lang="en"><head><meta charset="utf-8"><title>rotorlab: interface</title>'
    '<link rel="icon" href="data:,"><link rel="stylesheet" href="/login/login.css"></head>'
    '<body class="reference"><main>'
)


def reference_page(document: dict[str, Any]) -> str:
    """Every operation with what it is for, then every schema."""
    parts = [_HEAD, f"<h1>{html.escape(document['info']['title'])}</h1>"]
    parts.append(f"<p>{html.escape(document['info'].get('description', ''))}</p>")
    for path, operations in document["paths"].items():
        for method, operation in operations.items():
            parts.append(f"<h2>{method.upper()} {html.escape(path)}</h2>")
            parts.append(f"<p>{html.escape(operation.get('description', ''))}</p>")
    parts.append("<h1>Schemas</h1>")
    for name, schema in sorted(document["components"]["schemas"].items()):
        text = msgspec.json.format(msgspec.json.encode(schema), indent=2).decode()
        parts.append(f'<h2 id="{html.escape(name, quote=True)}">{html.escape(name)}</h2><pre>{html.escape(text)}</pre>')
    parts.append("</main></body></html>")
    return "\n".join(parts)
