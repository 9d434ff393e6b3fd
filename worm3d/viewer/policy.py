"""Content security policies: a page runs only its own scripts, and sends no requests to other hosts.

Markup that is smuggled in by a title or a scene could then only look odd.
"""

from __future__ import annotations

import base64
import hashlib
import re

_NOTHING_ELSE = "default-src 'none'; base-uri 'none'; form-action 'none'"
_STYLES = "style-src 'self' 'unsafe-inline'"
"""Rule for styles: meshcat writes the styles of the controls into the page."""


def of_page(page: str, *inner: str) -> str:
    """Return the policy of a self-contained page: the current scripts of the page, and data within the page.

    The pages `inner`, which are in frames of the page as text, obey this policy besides their own policies.
    """
    return f"{_NOTHING_ELSE}; script-src {_hashes(''.join((page, *inner)))}; {_STYLES}; img-src data: blob:"


def of_server(page: str, hosts: list[str]) -> str:
    """Return the policy of a page of meshcat's server: the page's scripts, and connections to these hosts."""
    # Policies do not support IPv6 addresses.
    sockets = " ".join(f"ws://{host}" for host in hosts if "[" not in host)
    return (
        f"{_NOTHING_ELSE}; script-src 'self' {_hashes(page)}; {_STYLES}; img-src 'self' data: blob:; "
        f"connect-src 'self' {sockets}; frame-ancestors 'none'"
    )


def _hashes(page: str) -> str:
    """Return the hashes of the scripts in a page, in the form for a policy."""
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
