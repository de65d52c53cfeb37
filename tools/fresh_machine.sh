#!/usr/bin/env bash
# Tries README's commands on a new Debian or Ubuntu: tools/fresh_machine.sh SUITE [PART...]
# SUITE: bookworm (Python 3.11), trixie (3.13) or Ubuntu's noble (3.12). PART: setup, run, test, repro (the smoke study by DVC) or core; all by default.
# setup begins with a new clone of this checkout; the other parts go on in it.
# Needs root, debootstrap, 12 GB below FRESH (default /var/tmp/blindspot-fresh) and the mirror MIRROR (default the distribution's).
# The new machine has Python, git and the certificates of this one, but none of its pip settings, packages or caches.
# CUDA=1 and MUJOCO_GL are passed on. Prints a row of the table in docs/results/machines.md for each part.
set -euo pipefail
cd "$(dirname "$(readlink -f "$0")")/.."
suite=${1:?a suite: bookworm, trixie or noble}
shift
parts=("$@")
if [ ${#parts[@]} = 0 ]; then parts=(setup run test repro core); fi
for part in "${parts[@]}"; do
  case "$part" in setup | run | test | repro | core) ;; *) echo "no part '$part': setup, run, test, repro or core" >&2; exit 2 ;; esac
done
root=${FRESH:-/var/tmp/blindspot-fresh}/$suite
logs=$root.logs
mkdir -p "$logs"

if [ ! -e "$root/usr/bin/git" ]; then
  mirror=http://deb.debian.org/debian options=() script=()
  if [ "$suite" = noble ]; then
    mirror=http://archive.ubuntu.com/ubuntu options=(--components=main,universe)
    script=(/usr/share/debootstrap/scripts/gutsy) # For all later releases, but Debian 12 does not list this one.
    # Debian does not have Ubuntu's key unless ubuntu-keyring is installed.
    if [ ! -e /usr/share/keyrings/ubuntu-archive-keyring.gpg ]; then options+=(--no-check-gpg); fi
  fi
  debootstrap --variant=minbase --include=python3,python3-venv,git,ca-certificates "${options[@]}" \
    "$suite" "$root" "${MIRROR:-$mirror}" "${script[@]}" >"$logs/debootstrap.log"
fi
cp /etc/resolv.conf /etc/hosts "$root/etc/"
find /usr/local/share/ca-certificates -name '*.crt' -exec cp {} "$root/usr/local/share/ca-certificates/" \; 2>/dev/null || true
bundle=/etc/ssl/certs/ca-certificates.crt
settings=(PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LANG=C.UTF-8 "PIP_CERT=$bundle" "SSL_CERT_FILE=$bundle" "REQUESTS_CA_BUNDLE=$bundle")
for name in CUDA MUJOCO_GL; do if [ -n "${!name:-}" ]; then settings+=("$name=${!name}"); fi; done

# A mount namespace of its own, so that nothing stays mounted when it ends or is killed.
inside() { # COMMAND
  unshare --mount --pid --fork bash -ec 'root=$1; shift
    mount -t proc proc "$root/proc"; mount --rbind /dev "$root/dev"; mount -t tmpfs tmpfs "$root/dev/shm"
    exec chroot "$root" "$@"' bash "$root" env -i "${settings[@]}" bash -c "$1"
}

inside "update-ca-certificates >/dev/null 2>&1"
if [ "${parts[0]}" = setup ]; then rm -rf "$root/root/blindspot"; fi
if [ ! -d "$root/root/blindspot" ]; then git clone --quiet . "$root/root/blindspot"; fi
packages() { inside "dpkg-query -W -f '\${Package}\n'" | sort; }
if [ "${parts[0]}" = setup ]; then packages >"$logs/packages.before"; fi

row() { # PART SECONDS OUTCOME
  local version build gl disk
  version=$(inside "python3 -c 'import platform; print(platform.python_version())'")
  build=$(inside "cd ~/blindspot && .venv/bin/python -c 'import torch; print(torch.__version__)'" 2>/dev/null || echo none)
  gl=$(inside "cd ~/blindspot && ls .cache/gl" 2>/dev/null | sed 's/.*-\(.*\)\.json/\1/' | paste -sd' ' || true)
  disk=$(du -sh "$root/root/blindspot" | cut -f1)
  echo "| $suite | $version | $build | ${gl:-none} | $1 | $2 | $disk | $3 |"
}

command_of() { # PART
  case "$1" in
  setup) echo "./run setup" ;;
  run) echo "./run" ;;
  test) echo "./run test" ;;
  core) echo "./run core" ;;
  repro) echo "source .venv/bin/activate && python -m pipeline compose study=smoke && dvc repro" ;;
  esac
}

failed=0
for part in "${parts[@]}"; do
  begin=$SECONDS code=0
  inside "cd ~/blindspot && $(command_of "$part")" >"$logs/$part.log" 2>&1 </dev/null || code=$?
  outcome="exit code $code"
  # The last line of pytest, without its timing.
  if [ "$code" = 0 ]; then outcome=$(grep -oE '[0-9]+ passed[^=]*' "$logs/$part.log" | tail -1 | sed 's/ in [0-9].*//' || true); fi
  row "$part" "$((SECONDS - begin))" "${outcome:-done}" | tee -a "$logs/rows.md"
  if [ "$code" != 0 ]; then
    tail -n 15 "$logs/$part.log" >&2
    failed=1
  fi
done
packages | comm -13 "$logs/packages.before" - >"$logs/packages.installed"
exit "$failed"
