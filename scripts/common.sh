# shellcheck shell=bash
# Sourced by the other scripts: messages, and installing missing packages on Debian and the like.

say() { printf '\n== %s\n' "$*"; }
die() {
  printf '%s: %s\n' "$(basename "$0")" "$*" >&2
  exit 2
}

cores() { nproc 2>/dev/null || echo 2; }

# need PACKAGE TEST...: records PACKAGE as missing unless the command TEST succeeds.
missing_packages=()
need() {
  local package=$1
  shift
  "$@" >/dev/null 2>&1 || missing_packages+=("$package")
}

# Succeeds if one of the given files exists.
any_file() {
  local file
  for file in "$@"; do [ -e "$file" ] && return 0; done
  return 1
}

# Installs what `need` found missing, or says what to do.
install_missing() {
  [ ${#missing_packages[@]} -eq 0 ] && return 0
  local list="${missing_packages[*]}" as_root=()
  command -v apt-get >/dev/null ||
    die "missing: $list (Debian package names), and there is no apt-get to install them"
  if [ "$(id -u)" -ne 0 ]; then
    command -v sudo >/dev/null ||
      die "missing: $list; install them as root with: apt-get install $list"
    as_root=(sudo)
  fi
  say "Installing $list"
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq update ||
    echo "apt-get update failed; trying with the present package lists" >&2
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq install -y \
    --no-install-recommends "${missing_packages[@]}" >/dev/null ||
    die "could not install $list; see the messages of apt-get above"
}

# Needed to build the library and its programs.
need_build_tools() {
  need g++ command -v g++
  need cmake command -v cmake
  need ninja-build command -v ninja
  need libeigen3-dev any_file /usr/include/eigen3 /usr/local/include/eigen3
  need libcli11-dev any_file /usr/include/CLI /usr/local/include/CLI
  need nlohmann-json3-dev any_file /usr/include/nlohmann /usr/local/include/nlohmann
  need libtinyxml2-dev any_file /usr/include/tinyxml2.h /usr/local/include/tinyxml2.h
}

# Needed for the tests and checks in addition.
need_test_tools() {
  need catch2 any_file /usr/include/catch2 /usr/local/include/catch2
  need clang command -v clang++
  need clang-format command -v clang-format
  need clang-tidy command -v clang-tidy
  need lld command -v ld.lld
  need pkg-config command -v pkg-config
  need libbenchmark-dev any_file /usr/include/benchmark /usr/local/include/benchmark
  need python3 command -v python3
  need nodejs command -v node
}
