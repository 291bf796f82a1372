#!/usr/bin/env bash
# check_rooms.sh ROOMS.TXT SOURCE_FOLDER: every include across rooms needs a link, and every link between rooms is used.
# Says which are missing or unused. Run by the test `rooms`; the table is written by rooms.cmake.
set -euo pipefail
table=$1
cd "$2"

cut -d '|' -f 1 "$table" | while read -r folder; do
  [[ -d "$folder" ]] || { echo "$folder: no such folder" >&2; exit 1; }
done
top=$(cut -d '|' -f 1 "$table" | cut -d / -f 1 | sort -u)
# shellcheck disable=SC2086 # folders have no blanks
grep -rHoE --include='*.hpp' --include='*.cpp' '^#include "[^"]+' $top | sed 's/:#include "/ /' | awk -v table="$table" '
  function room_of(path,    best, room) {
    best = ""
    for (room in targets) {
      if (index(path, room "/") == 1 && length(room) > length(best)) { best = room }
    }
    return best
  }
  BEGIN {
    while ((getline line < table) > 0) {
      split(line, field, "|")
      targets[field[1]] = field[2]
      links[field[1]] = " " field[3] " " field[2] " "
      n = split(field[2], own, " ")
      for (i = 1; i <= n; ++i) { owner[own[i]] = field[1] }
    }
  }
  {
    from = room_of($1)
    to = room_of($2)
    if (from == "") { print $1 ": its folder is not a room (bregma_room)"; bad = 1; next }
    if (to == "" || from == to) { next } # generated, or its own
    n = split(targets[to], wanted, " ")
    found = 0
    for (i = 1; i <= n; ++i) {
      if (index(links[from], " " wanted[i] " ") > 0) { found = 1; used[from, wanted[i]] = 1 }
    }
    if (!found) { print $1 ": includes " $2 ", but " targets[from] " does not link " targets[to]; bad = 1 }
    ++checked
  }
  END {
    if (checked < 100) { print "only " checked + 0 " includes across rooms were found: is the source folder right?"; bad = 1 }
    exit bad
  }' >&2
