"""The image's health check: ends well where the service says that it is ready. Standard library only."""

from __future__ import annotations

import os
import ssl
import sys
from urllib.error import HTTPError, URLError
from urllib.request import HTTPSHandler, ProxyHandler, build_opener


def main() -> int:
    """0 where it is ready, 1 where not, with what it says; it asks itself, so the certificate is not looked at."""
    scheme = "https" if os.environ.get("INSPECTOR_TLS_CERT") else "http"
    url = f"{scheme}://127.0.0.1:{os.environ.get('INSPECTOR_PORT', '8000')}/readyz"
    unchecked = ssl.create_default_context()
    unchecked.check_hostname, unchecked.verify_mode = False, ssl.CERT_NONE
    try:
        with build_opener(ProxyHandler({}), HTTPSHandler(context=unchecked)).open(url, timeout=4):
            return 0
    except HTTPError as error:
        print(error.read(2000).decode(errors="replace"))
    except (URLError, OSError) as error:
        print(error)
    return 1


if __name__ == "__main__":
    sys.exit(main())
