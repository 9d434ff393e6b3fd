"""Content security policies. They make a page run only its own scripts and send no requests to other hosts.

If a title or a scene contained malicious markup, this markup could then not run code.
"""

from __future__ import annotations

import base64
import hashlib
import re
from html import escape

_NOTHING_ELSE = "default-src 'none'; base-uri 'none'; form-action 'none'"
_STYLES = "style-src 'self' 'unsafe-inline'"
"""Rule for styles. Inline styles are allowed because meshcat writes the styles of its controls into the page."""


def of_page(page: str, *inner: str, live: bool = False) -> str:
    """Return the policy of a page, which allows its present scripts and images from data in the page.

    `inner` are pages that the page contains in frames. They have to obey this policy and their own policies. A `live`
    page may connect to the server that it comes from, and a page from disc to none.
    """
    scripts = f"{_hashes(''.join((page, *inner)))}{_nonces(page)}"
    own = "; connect-src 'self'" if live else ""
    return f"{_NOTHING_ELSE}; script-src {scripts}; {_STYLES}; img-src data: blob:{own}"


def script_file(address: str, page: str) -> str:
    """Return the element of a page that loads a script from a file.

    The element has a nonce, and `of_page` allows a script with this nonce. For a page from disc, 'self' would allow all
    files of the disc, and browsers do not compare files of the disc with hashes. The nonce is a hash of the other
    contents of the page, `page`, so that the same contents give the same page.
    """
    nonce = base64.b64encode(hashlib.sha256(page.encode()).digest()).decode()
    return f'<script nonce="{nonce}" src="{escape(address, quote=True)}"></script>'


def _hashes(page: str) -> str:
    """Return the hashes of the scripts in a page, in the form for a policy."""
    scripts = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)


def _nonces(page: str) -> str:
    """Return the nonces of the script files of a page, in the form for a policy."""
    return "".join(f" 'nonce-{nonce}'" for nonce in re.findall(r'<script nonce="([^"]*)" src=', page))
