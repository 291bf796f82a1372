#include "clients/cli/registration/point_pairs.hpp"

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <set>
#include <string_view>

#include "base/text.hpp"

namespace bregma::cli {

namespace {

using base::Result;

constexpr std::size_t kMinPairs = 3;

std::vector<std::string> names_of(const NamedList &list) {
  std::vector<std::string> out;
  for (const casefile::NamedPoint &point : list.points->points) {
    out.emplace_back(base::trimmed(point.name));
  }
  return out;
}

struct Numbered {
  std::string prefix;
  std::vector<std::uint64_t> numbers;
};

// Names that are one text followed by different numbers.
std::optional<Numbered> numbered(const std::vector<std::string> &names) {
  Numbered out;
  std::set<std::uint64_t> seen;
  for (const std::string &name : names) {
    const std::size_t digits = name.find_last_not_of("0123456789") + 1; // npos + 1 = 0
    const auto number = base::parsed_number<std::uint64_t>(std::string_view(name).substr(digits));
    const std::string prefix = name.substr(0, digits);
    if (!number || (!seen.empty() && prefix != out.prefix) || !seen.insert(*number).second) {
      return std::nullopt;
    }
    out.prefix = prefix;
    out.numbers.push_back(*number);
  }
  return out;
}

std::string quoted(const std::vector<std::string> &names) {
  constexpr std::size_t kShown = 12;
  std::string out;
  for (std::size_t i = 0; i < std::min(names.size(), kShown); ++i) {
    out += (i == 0 ? "\"" : ", \"") + names[i] + "\"";
  }
  return out + (names.size() > kShown ? " and " + std::to_string(names.size() - kShown) + " more" : "");
}

Result<Pairing> by_order_of(const NamedList &source, const NamedList &target, std::string why) {
  const std::size_t count = source.points->points.size();
  if (const std::size_t other = target.points->points.size(); count != other) {
    return base::failure(source.file + " has " + std::to_string(count) + " points, " + target.file + " has " +
                         std::to_string(other) + ": they must be pairs to be paired by their order");
  }
  Pairing out;
  for (std::size_t i = 0; i < count; ++i) {
    out.pairs.push_back({std::to_string(i + 1), i, i});
  }
  out.notes.push_back(std::move(why) + ": they are paired by their order");
  return out;
}

Result<void> check_unique(const NamedList &list, const std::vector<std::string> &names) {
  std::set<std::string_view> seen;
  for (const std::string &name : names) {
    if (!seen.insert(name).second) {
      return base::failure(list.file + ": two points are called \"" + name +
                           "\"; --by-order pairs the points by their order");
    }
  }
  return {};
}

// Pairs equal keys. names: those of the two lists, for the notes.
template <class Key> struct Keys { std::vector<Key> source, target; };

template <class Key> Pairing by_key(const Keys<Key> &keys, const std::vector<std::string> &source_names) {
  std::map<Key, std::size_t> targets;
  for (std::size_t i = 0; i < keys.target.size(); ++i) {
    targets.try_emplace(keys.target[i], i);
  }
  Pairing out;
  for (std::size_t i = 0; i < keys.source.size(); ++i) {
    if (const auto found = targets.find(keys.source[i]); found != targets.end()) {
      out.pairs.push_back({source_names[i], i, found->second});
      targets.erase(found);
    }
  }
  return out;
}

std::vector<std::string> folded(const std::vector<std::string> &names) {
  std::vector<std::string> out;
  std::transform(names.begin(), names.end(), std::back_inserter(out),
                 [](const std::string &name) { return base::lower(name); });
  return std::set<std::string>(out.begin(), out.end()).size() == out.size() ? out : names;
}

void note_partnerless(const NamedList &list, const std::vector<std::string> &names,
                      const std::vector<std::size_t> &paired, Pairing &out) {
  std::vector<std::string> left;
  for (std::size_t i = 0; i < names.size(); ++i) {
    if (std::find(paired.begin(), paired.end(), i) == paired.end()) {
      left.push_back(names[i]);
    }
  }
  if (!left.empty()) {
    out.notes.push_back(list.file + ": " + quoted(left) + (left.size() == 1 ? " has" : " have") + " no partner and " +
                        (left.size() == 1 ? "is" : "are") + " not used");
  }
}

} // namespace

Result<Pairing> pair_points(const NamedList &source, const NamedList &target, bool by_order) {
  const bool named = source.points->named && target.points->named;
  if (by_order) {
    return by_order_of(source, target, "--by-order");
  }
  for (const NamedList *list : {&source, &target}) {
    const auto &points = list->points->points;
    const auto nameless = std::count_if(points.begin(), points.end(),
                                        [](const casefile::NamedPoint &p) { return base::trimmed(p.name).empty(); });
    if (nameless > 0 && static_cast<std::size_t>(nameless) < points.size()) {
      return base::failure(list->file + ": " + std::to_string(nameless) + " of " + std::to_string(points.size()) +
                           " points have no name; --by-order pairs the points by their order");
    }
  }
  if (!named) {
    const bool neither = !source.points->named && !target.points->named;
    return by_order_of(source, target,
                       neither ? "the points have no names"
                               : (source.points->named ? target.file : source.file) + ": the points have no names");
  }
  const std::vector<std::string> source_names = names_of(source);
  const std::vector<std::string> target_names = names_of(target);
  for (const auto &[list, names] : {std::pair(&source, &source_names), {&target, &target_names}}) {
    if (auto unique = check_unique(*list, *names); !unique) {
      return tl::unexpected(unique.error());
    }
  }
  Pairing out;
  const auto source_numbers = numbered(source_names);
  const auto target_numbers = numbered(target_names);
  if (source_numbers && target_numbers) {
    out = by_key(Keys<std::uint64_t>{source_numbers->numbers, target_numbers->numbers}, source_names);
    const bool equal = std::all_of(out.pairs.begin(), out.pairs.end(), [&](const Pairing::Pair &pair) {
      return source_names[pair.source] == target_names[pair.target];
    });
    if (!equal) {
      out.notes.push_back("the names differ, their numbers do not: paired by number (\"" +
                          source_names[out.pairs.front().source] + "\" and \"" +
                          target_names[out.pairs.front().target] + "\")");
    }
  } else {
    out = by_key(Keys<std::string>{folded(source_names), folded(target_names)}, source_names);
  }
  if (out.pairs.size() < std::min({kMinPairs, source_names.size(), target_names.size()})) {
    return base::failure(source.file + " and " + target.file + " have " + std::to_string(out.pairs.size()) +
                         " names in common: " + quoted(source_names) + " and " + quoted(target_names) +
                         "; --by-order pairs the points by their order");
  }
  std::vector<std::size_t> of_source;
  std::vector<std::size_t> of_target;
  for (const Pairing::Pair &pair : out.pairs) {
    of_source.push_back(pair.source);
    of_target.push_back(pair.target);
  }
  note_partnerless(source, source_names, of_source, out);
  note_partnerless(target, target_names, of_target, out);
  return out;
}

} // namespace bregma::cli
