#include "server/session/snapshot.hpp"

#include <algorithm>
#include <cstdio>
#include <stdexcept>

#include <boost/crc.hpp>
#include <nlohmann/json.hpp>

#include "idl/names.hpp"
#include "server/session/state_machine.hpp"

namespace bregma::server {
namespace {

using nlohmann::json;

constexpr int kVersion =
    3; // 1: the stage as a number of an enumeration numbered anew since; 2: no checksum of the case

std::string checksum(const std::string &text) {
  boost::crc_32_type crc;
  crc.process_bytes(text.data(), text.size());
  char out[16];
  std::snprintf(out, sizeof out, "%08x", static_cast<unsigned>(crc.checksum()));
  return out;
}

// A folder's name may not be valid UTF-8. Such a case is not found again, but nothing else is lost.
std::string dump(const json &value) { return value.dump(-1, ' ', false, json::error_handler_t::replace); }

void read_name(const json &from, const char *key, wire::Name &to) {
  const std::string value = from.at(key).get<std::string>();
  if (!wire::set_name(to, value)) {
    throw std::length_error(std::string(key) + " = \"" + value + "\" is too long for a name");
  }
}

json write(const CalibratedTip &tip) {
  return {
      {"tip_mm", tip.tip_mm}, {"covariance_mm2", tip.covariance_mm2}, {"rms_mm", tip.rms_mm}, {"time_ns", tip.time_ns}};
}

CalibratedTip read_tip(const json &from) {
  return {from.at("tip_mm"), from.at("covariance_mm2"), from.at("rms_mm"), from.at("time_ns")};
}

template <class Sample> constexpr bool kHasCommon = requires(Sample sample) { sample.common_mm2; };
template <class Sample> constexpr bool kHasBeam = requires(Sample sample) { sample.towards_sensor; };

// Fiducial and surface samples differ only by the name of the point. They get the set's revision again when sent. A
// common error and a beam are 0 for samples of a stylus, and then not written.
template <class Sample> json write_sample(const Sample &sample) {
  json out = {{"tool", wire::text(sample.tool)},
              {"frame", sample.frame},
              {"acquired_time_ns", sample.acquired_time_ns},
              {"position_mm", sample.position_mm},
              {"covariance_mm2", sample.covariance_mm2}};
  if constexpr (kHasCommon<Sample>) {
    if (sample.common_mm2 != Array9{}) {
      out["common_mm2"] = sample.common_mm2;
    }
  }
  if constexpr (kHasBeam<Sample>) {
    if (sample.towards_sensor != Array3{}) {
      out["towards_sensor"] = sample.towards_sensor;
      out["across"] = sample.across;
    }
  }
  return out;
}

template <class Sample> Sample read_sample(const json &from) {
  Sample out{};
  read_name(from, "tool", out.tool);
  from.at("frame").get_to(out.frame);
  from.at("acquired_time_ns").get_to(out.acquired_time_ns);
  from.at("position_mm").get_to(out.position_mm);
  from.at("covariance_mm2").get_to(out.covariance_mm2);
  if constexpr (kHasCommon<Sample>) {
    if (from.contains("common_mm2")) {
      from.at("common_mm2").get_to(out.common_mm2);
    }
  }
  if constexpr (kHasBeam<Sample>) {
    if (from.contains("towards_sensor")) {
      from.at("towards_sensor").get_to(out.towards_sensor);
      from.at("across").get_to(out.across);
    }
  }
  return out;
}

json write(const JudgedCheck &check) {
  json out = write_sample(check);
  out["landmark_index"] = check.landmark_index;
  out["error_mm"] = check.error_mm;
  out["touch_covariance_mm2"] = check.touch_covariance_mm2;
  out["distance_mm"] = check.distance_mm;
  out["limit_mm"] = check.limit_mm;
  return out;
}

JudgedCheck read_check(const json &from, const std::string &landmark) {
  auto out = read_sample<JudgedCheck>(from);
  read_name({{"landmark", landmark}}, "landmark", out.landmark);
  from.at("landmark_index").get_to(out.landmark_index);
  from.at("error_mm").get_to(out.error_mm);
  from.at("touch_covariance_mm2").get_to(out.touch_covariance_mm2);
  from.at("distance_mm").get_to(out.distance_mm);
  from.at("limit_mm").get_to(out.limit_mm);
  return out;
}

json write(const RegistrationAccepted &accepted) {
  json out = {{"revision", accepted.revision},
              {"rotation_wxyz", accepted.T_image_reference.rotation_wxyz},
              {"translation_mm", accepted.T_image_reference.translation_mm},
              {"covariance", accepted.covariance}};
  if (accepted.excess_mm != Array3{}) {
    out["excess_mm"] = accepted.excess_mm;
  }
  return out;
}

RegistrationAccepted read_accepted(const json &from) {
  RegistrationAccepted out{};
  from.at("revision").get_to(out.revision);
  from.at("rotation_wxyz").get_to(out.T_image_reference.rotation_wxyz);
  from.at("translation_mm").get_to(out.T_image_reference.translation_mm);
  from.at("covariance").get_to(out.covariance);
  if (from.contains("excess_mm")) {
    from.at("excess_mm").get_to(out.excess_mm);
  }
  return out;
}

SessionData read_session(const json &from) {
  SessionData data;
  const std::string name = from.at("stage");
  const auto stage = stage_named(name);
  if (!stage) {
    throw std::out_of_range("stage = \"" + name + "\" is no stage of a session");
  }
  data.stage = *stage;
  from.at("case_folder").get_to(data.case_folder);
  from.at("case_id").get_to(data.case_id);
  from.at("case_checksum").get_to(data.case_checksum);
  from.at("recording").get_to(data.recording);
  from.at("revision").get_to(data.revision);
  for (const auto &[tool, tip] : from.at("tips").items()) {
    data.tips[tool] = read_tip(tip);
  }
  for (const auto &[point, sample] : from.at("fiducials").items()) {
    auto &fiducial = data.fiducials[point] = read_sample<FiducialSample>(sample);
    read_name({{"point", point}}, "point", fiducial.point);
  }
  for (const json &sample : from.at("surface")) {
    data.surface.push_back(read_sample<SurfaceSample>(sample));
  }
  if (from.contains("accepted")) {
    data.accepted = read_accepted(from.at("accepted"));
  }
  for (const auto &[landmark, check] : from.at("checks").items()) {
    data.checks[landmark] = read_check(check, landmark);
  }
  return data;
}

} // namespace

std::string to_json(const SessionData &data) {
  json session = {{"stage", state_name(data.stage)}, {"case_folder", data.case_folder},
                  {"case_id", data.case_id},         {"case_checksum", data.case_checksum},
                  {"recording", data.recording},     {"revision", data.revision},
                  {"tips", json::object()},          {"fiducials", json::object()},
                  {"surface", json::array()},        {"checks", json::object()}};
  for (const auto &[tool, tip] : data.tips) {
    session["tips"][tool] = write(tip);
  }
  for (const auto &[point, sample] : data.fiducials) {
    session["fiducials"][point] = write_sample(sample);
  }
  for (const SurfaceSample &sample : data.surface) {
    session["surface"].push_back(write_sample(sample));
  }
  if (data.accepted) {
    session["accepted"] = write(*data.accepted);
  }
  for (const auto &[landmark, check] : data.checks) {
    session["checks"][landmark] = write(check);
  }
  const std::string sum = checksum(dump(session));
  return dump({{"bregma_session", kVersion}, {"crc32", sum}, {"session", std::move(session)}}) + "\n";
}

base::Result<SessionData> from_json(const std::string &text, const std::string &name) {
  try {
    const json file = json::parse(text);
    const int version = file.at("bregma_session");
    if (version != kVersion) {
      return base::failure(name + ": bregma_session = " + std::to_string(version) + ": this program reads version " +
                           std::to_string(kVersion));
    }
    const json &session = file.at("session");
    const std::string sum = checksum(dump(session));
    if (file.at("crc32") != sum) {
      return base::failure(name + ": crc32 = " + file.at("crc32").dump() + ": the content has \"" + sum +
                           "\", the file is damaged");
    }
    if (dump(file) + "\n" != text) { // damage that changes the text but not the values
      return base::failure(name + ": is not as it was written, the file is damaged");
    }
    return read_session(session);
  } catch (const json::parse_error &error) {
    return base::failure(name + ": not a session that can be read: its JSON ends or breaks at byte " +
                         std::to_string(std::min(error.byte, text.size())) + " of " + std::to_string(text.size()));
  } catch (const json::exception &) { // a key is missing or has another type
    return base::failure(name + ": not a session that can be read: a value is missing or of another kind");
  } catch (const std::exception &error) { // from the checks above
    return base::failure(name + ": not a session that can be read: " + error.what());
  }
}

} // namespace bregma::server
