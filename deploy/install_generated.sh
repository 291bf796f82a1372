#!/usr/bin/env bash
# install_generated.sh DESTDIR PREFIX VERSION: called by cmake --install. Makes what the installed programs say about
# themselves: manual pages from --help, completion, the default configuration; and the systemd units with their path.
set -euo pipefail
destdir=$1 prefix=$2 version=$3
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
bin=$destdir$prefix/bin share=$destdir$prefix/share
command -v help2man >/dev/null || { echo "the manual pages need help2man (apt install help2man)" >&2; exit 1; }
mkdir -p "$share"/{man/man1,bash-completion/completions,zsh/site-functions,bregma} "$destdir$prefix/lib/systemd/system"

# page NAME "COMMAND WORDS" TITLE. help2man fills the examples like prose: each begins a line again.
page() {
  help2man --no-info --version-string="$version" --name="$3" "$bin/$2" |
    sed -e "1,/^\\.SH NAME/s/^\\.TH [^ ]*/.TH ${1^^}/" -e "/^\\.SH NAME/{n;s/^$2 /$1 /}" \
      -e '/^\.SH EXAMPLES/,/^\.SH [^E]/s/^bregma/.br\n&/' >"$share/man/man1/$1.1"
}
# pages "COMMAND WORDS" TITLE: the page of a command and those of its subcommands, bregma-register-points(1).
pages() {
  local name=${1// /-} help line
  page "$name" "$1" "$2"
  help=$("$bin"/$1 --help | sed '1,/^Subcommands:$/d; /^$/,$d') # unquoted: a command and its words
  while IFS= read -r line; do
    # A description that did not fit beside its command stands below it.
    if [[ $line =~ ^\ \ ([a-z][a-z-]*)\ *(.*)$ ]]; then
      pages "$1 ${BASH_REMATCH[1]}" "${BASH_REMATCH[2]:-see ${name}(1)}"
    fi
  done <<<"$help"
}
pages bregma "neurosurgical navigation from the command line"
pages bregmad "the real-time core of neurosurgical navigation"
pages bregma-sim-room "a simulated operating room"
pages bregma-gateway "the state of bregmad for browsers of this host"
pages bregma-case-server "sends the files of bregmad's case to displays"
pages bregma-arm "driver of an arm behind a socket"
pages bregma-range "driver of an infrared range sensor"

"$bin/bregma" completion bash >"$share/bash-completion/completions/bregma"
"$bin/bregma" completion zsh >"$share/zsh/site-functions/_bregma"
"$bin/bregmad" --print-config >"$share/bregma/bregmad.toml"
"$bin/bregma-arm" --print-config >"$share/bregma/arm.toml"
"$bin/bregma-range" --print-config >"$share/bregma/range.toml"
for unit in bregmad bregma-gateway bregma-case-server bregma-arm bregma-range; do
  sed -e "s|/usr/bin/|$prefix/bin/|; s|/usr/share/|$prefix/share/|" "$here/$unit.service" \
    >"$destdir$prefix/lib/systemd/system/$unit.service"
done
sed -e "s|/usr/share/doc|$prefix/share/doc|" "$here/bregma-kiosk.service" >"$destdir$prefix/lib/systemd/system/bregma-kiosk.service"
