# Shared by the scripts beside it: installs what is missing, and says so.

say() { printf '\n== %s\n' "$*" >&2; }

# need COMMAND PACKAGE...: installs Debian packages unless the command is there.
need() {
  local command=$1
  shift
  command -v "$command" >/dev/null && return
  command -v apt-get >/dev/null || { echo "$command is missing: install it (Debian: $*)" >&2; exit 1; }
  local root=()
  if [ "$(id -u)" != 0 ]; then
    command -v sudo >/dev/null || { echo "$command is missing: as root, apt-get install $*" >&2; exit 1; }
    root=(sudo)
  fi
  say "installing $* (for $command)"
  [ -n "${apt_updated:-}" ] || { "${root[@]}" apt-get -qq update && apt_updated=1; }
  "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "$@" >&2
}

# rustup puts cargo here; a shell that was open before does not know yet.
command -v cargo >/dev/null || PATH="$HOME/.cargo/bin:$PATH"
command -v cargo >/dev/null || { echo "Rust is missing: install it from https://rustup.rs" >&2; exit 1; }
