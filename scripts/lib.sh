# Functions for the scripts in this directory. They install what is missing and report it.

say() { printf '\n== %s\n' "$*" >&2; }

# need COMMAND PACKAGE...: installs Debian packages unless the command exists.
need() {
  command -v "$1" >/dev/null || install_packages "$@"
}

# want COMMAND PACKAGE...: like need, but what cannot be installed is only reported: tests that need it are skipped.
want() {
  command -v "$1" >/dev/null || (install_packages "$@") ||
    echo "SKIPPED: tests that need $1, which cannot be installed (Debian: ${*:2})"
}

# The build needs libclang to read the kernel's camera headers. Searches where clang-sys does.
need_libclang() {
  local found
  [ -z "${LIBCLANG_PATH:-}" ] || return 0
  # find -L fails on dangling links.
  found=$(find -L /usr/lib /usr/local/lib -maxdepth 3 \( -name 'libclang.so*' -o -name 'libclang-[0-9]*.so*' \) \
    -print -quit 2>/dev/null || true)
  [ -n "$found" ] || install_packages libclang libclang1
}

# install_packages WHAT-FOR PACKAGE...
install_packages() {
  local command=$1
  shift
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

# rustup puts cargo here, but shells opened before the installation do not have it in PATH.
command -v cargo >/dev/null || PATH="$HOME/.cargo/bin:$PATH"
command -v cargo >/dev/null || { echo "Rust is missing: install it from https://rustup.rs" >&2; exit 1; }
