#!/usr/bin/env bash
# Installs what tools/browse_site.py needs, Debian's Chromium and its driver, unless they are there; needs root.
set -euo pipefail
packages=(chromium chromium-driver python3-selenium)
if ! dpkg --status "${packages[@]}" >/dev/null 2>&1; then
    export DEBIAN_FRONTEND=noninteractive
    apt-get update -qq
    apt-get install --yes -qq --no-install-recommends "${packages[@]}"
fi
