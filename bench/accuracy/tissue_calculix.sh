#!/usr/bin/env bash
# The tissue solver beside CalculiX: installs CalculiX (Debian's calculix-ccx), and runs that part of bench_tissue.
# Options are handed on, for example --json or --quick.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

if ! command -v ccx >/dev/null; then
  as_root=()
  [[ $EUID -eq 0 ]] || as_root=(sudo)
  "${as_root[@]}" apt-get update -qq
  DEBIAN_FRONTEND=noninteractive "${as_root[@]}" apt-get install -y -qq --no-install-recommends calculix-ccx >/dev/null
fi
[[ -x build/release/bin/bench_tissue ]] || ./dev build >&2
exec build/release/bin/bench_tissue --only calculix "$@"
