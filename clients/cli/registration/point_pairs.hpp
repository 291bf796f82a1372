// Which point of one list is which of another.
//
// By name where both lists have names; a list may name points that the other does not have, which are told. By number
// where the names of each list are one text and different numbers ("1" and "01", "From-1" and "To-1"). By order only
// where a list has no names, or on request.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "base/result.hpp"
#include "clients/cli/registration/point_file.hpp"

namespace bregma::cli {

struct NamedList {
  std::string file;
  const PointFile *points;
};

struct Pairing {
  struct Pair {
    std::string name;
    std::size_t source = 0, target = 0; // indices
  };
  std::vector<Pair> pairs;        // in the order of the source
  std::vector<std::string> notes; // how they were paired, if not by equal names, and which points have no partner
};

// Refused: lists of different length by order, two points of one name, fewer than three common names.
[[nodiscard]] base::Result<Pairing> pair_points(const NamedList &source, const NamedList &target, bool by_order);

} // namespace bregma::cli
