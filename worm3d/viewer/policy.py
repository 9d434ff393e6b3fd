"""Content security policies: a page runs its own scripts, and asks nobody for anything.

A title or a scene that smuggles in markup could then do no more than look odd.
"""

from __future__ import annotations

import base64
import hashlib
import re

_NOTHING_ELSE = "default-src 'none'; base-uri 'none'; form-action 'none'"
_STYLES = "style-src 'self' 'unsafe-inline'"
"""Rule for styles: meshcat writes those of its controls into the page."""


def of_page(page: str, *inner: str) -> str:
    """Return the policy of a page that stands alone: the scripts that it has now, and data within it.

    What stands in frames of it, as text of the pages `inner`, is bound by this policy besides its own.
    """
    return f"{_NOTHING_ELSE}; script-src {_hashes(''.join((page, *inner)))}; {_STYLES}; img-src data: blob:"


def of_server(page: str, hosts: list[str]) -> str:
    """Return the policy of a page of meshcat's server: its scripts, and a connection to the server at these hosts."""
    # Policies know no addresses of IPv6.
    sockets = " ".join(f"ws://{host}" for host in hosts if "[" not in host)
    return (
        f"{_NOTHING_ELSE}; script-src 'self' {_hashes(page)}; {_STYLES}; img-src 'self' data: blob:; "
        f"connect-src 'self' {sockets}; frame-ancestors 'none'"
    )


def _hashes(page: str) -> str:
    """Return the hashes of the scripts in a page, as a policy names them."""
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
