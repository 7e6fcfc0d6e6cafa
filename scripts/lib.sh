# Shared by the scripts beside it: installs what is missing, and says so.

say() { printf '\n== %s\n' "$*" >&2; }

# need COMMAND PACKAGE...: installs Debian packages unless the command is there.
need() {
  local command=$1
  shift
  command -v "$command" >/dev/null && return
  command -v apt-get >/dev/null || { echo "$command is missing: install it (Debian: $*)" >&2; exit 1; }
  say "installing $* (for $command)"
  local root=''
  [ "$(id -u)" = 0 ] || root=sudo
  [ -n "${apt_updated:-}" ] || { $root apt-get -qq update && apt_updated=1; }
  $root env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y --no-install-recommends "$@" >&2
}

command -v cargo >/dev/null || { echo "Rust is missing: install it from https://rustup.rs" >&2; exit 1; }
