#!/usr/bin/env bash
# check_rooms.sh ROOMS.TXT SOURCE_FOLDER: every include across rooms needs a link, and every link between rooms an include.
# Prints those that are missing or unused. Run by the test `rooms`; the table is written by rooms.cmake.
set -euo pipefail
table=$1
cd "$2"

mapfile -t folders < <(cut -d '|' -f 1 "$table" | sort -u)
for folder in "${folders[@]}"; do
  [[ -d "$folder" ]] || { echo "$folder: no such folder" >&2; exit 1; }
done
mapfile -t top < <(printf '%s\n' "${folders[@]}" | cut -d / -f 1 | sort -u)
grep -rHoE --include='*.hpp' --include='*.cpp' '^#include "[^"]+' "${top[@]}" | sed 's/:#include "/ /' | awk -v table="$table" '
  function room_of(path,    best, folder) {
    best = ""
    for (folder in targets) {
      if (index(path, folder "/") == 1 && length(folder) > length(best)) { best = folder }
    }
    return best
  }
  function has(words, word) { return index(" " words " ", " " word " ") > 0 }
  function any(words, among,    n, i, list) { # of these words, is one among those
    n = split(words, list, " ")
    for (i = 1; i <= n; ++i) { if (has(among, list[i])) { return 1 } }
    return 0
  }
  BEGIN {
    while ((getline line < table) > 0) {
      split(line, field, "|")
      targets[field[1]] = targets[field[1]] " " field[2]
      links[field[1]] = links[field[1]] " " field[2] " " field[3]
      links_of[field[2]] = field[3]
      folders_of[field[2]] = folders_of[field[2]] " " field[1]
    }
  }
  {
    from = room_of($1)
    to = room_of($2)
    if (from == "") { print $1 ": its folder is not a room (bregma_room)"; bad = 1; next }
    if (to == "" || from == to) { next } # generated, or its own
    if (!any(targets[to], links[from])) {
      print $1 ": includes " $2 ", but" targets[from] " does not link" targets[to]; bad = 1
    }
    included[from] = included[from] " " to
    ++checked
  }
  END {
    for (target in links_of) {
      all = ""
      n = split(folders_of[target], own, " ")
      for (i = 1; i <= n; ++i) { all = all " " included[own[i]] " " own[i] }
      n = split(links_of[target], linked, " ")
      for (i = 1; i <= n; ++i) {
        if (linked[i] in folders_of && !any(folders_of[linked[i]], all)) {
          print target " links " linked[i] ", but includes nothing of" folders_of[linked[i]]; bad = 1
        }
      }
    }
    if (checked < 100) { print "only " checked + 0 " includes across rooms were found: is the source folder right?"; bad = 1 }
    exit bad
  }' >&2
