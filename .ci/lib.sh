# What .ci/run and .ci/nightly have in common; sourced by both from the project's root.
set -euo pipefail

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
python=${PYTHON:-python3}
system_path=$PATH
export PIP_DISABLE_PIP_VERSION_CHECK=1 NO_MKDOCS_2_WARNING=1
torch='torch==2.13.0'  # on Linux the build without CUDA

step() { printf '\n== %s (%d:%02d)\n' "$*" $((SECONDS / 60)) $((SECONDS % 60)); }

# Make an environment and use it from here on: enter NAME PYTHON
enter() {
    "$2" -m venv "$scratch/$1"
    export PATH="$scratch/$1/bin:$system_path" VIRTUAL_ENV="$scratch/$1"
    pip install --quiet uv
}

need_chromium() {
    if ! command -v chromium >/dev/null; then
        local as_root
        as_root=$([ "$(id -u)" = 0 ] || echo sudo)
        $as_root apt-get update -q && $as_root apt-get install -q -y chromium
    fi
}

# Run pytest; a test that is skipped is an error, since what it needs was installed for it: pytest_whole ARGUMENTS
pytest_whole() {
    local log
    log=$(mktemp -p "$scratch")
    pytest -rs "$@" 2>&1 | tee "$log"
    if grep -q '^SKIPPED' "$log"; then echo "Tests were skipped for which everything was installed." >&2; return 1; fi
}

# Run two functions at once, and show the second one's output after the first one's: together FIRST SECOND
together() {
    "$2" >"$scratch/$2.log" 2>&1 &
    local second=$! failed=0
    "$1" || failed=1
    wait "$second" || failed=1
    cat "$scratch/$2.log"
    return "$failed"
}
