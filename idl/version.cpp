#include "idl/version.hpp"

#include <cerrno>
#include <charconv>

namespace bregma::wire {
namespace {

constexpr std::string_view kWire = "bregma.wire=";
constexpr std::string_view kProgram = ";program=";

// Removes a number from the front of text.
bool take_number(std::string_view &text, std::uint32_t &out) {
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), out);
  text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  return code == std::errc();
}

bool take(std::string_view &text, std::string_view expected) {
  const bool there = text.substr(0, expected.size()) == expected;
  text.remove_prefix(there ? expected.size() : 0);
  return there;
}

std::optional<WireVersion> take_version(std::string_view &text) {
  WireVersion out;
  const bool whole = take_number(text, out.generation) && take(text, ".") && take_number(text, out.revision);
  return whole ? std::optional(out) : std::nullopt;
}

} // namespace

std::string text_of(const WireVersion &version) {
  return std::to_string(version.generation) + "." + std::to_string(version.revision);
}

std::optional<WireVersion> version_from(std::string_view text) {
  const auto out = take_version(text);
  return text.empty() ? out : std::nullopt;
}

std::string to_user_data(const Announcement &announcement) {
  return std::string(kWire) + text_of(announcement.version) + std::string(kProgram) + announcement.program;
}

std::optional<Announcement> from_user_data(std::string_view data) {
  const auto version = take(data, kWire) ? take_version(data) : std::nullopt;
  if (!version) {
    return std::nullopt;
  }
  Announcement out{*version, {}};
  if (take(data, kProgram)) {
    out.program = data.substr(0, data.find(';')); // a later revision may state more
  }
  return out;
}

Announcement own_announcement() { return {kWireVersion, program_invocation_short_name}; }

} // namespace bregma::wire
