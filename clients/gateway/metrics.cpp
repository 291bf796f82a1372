#include "clients/gateway/metrics.hpp"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>
#include <vector>

#include <prometheus/metric_family.h>
#include <prometheus/text_serializer.h>

#include "clients/gateway/layout.hpp"

namespace bregma::gateway {
namespace {

prometheus::Counter &counter(prometheus::Registry &registry, const char *name, const char *help) {
  return prometheus::BuildCounter().Name(name).Help(help).Register(registry).Add({});
}
prometheus::Gauge &gauge(prometheus::Registry &registry, const char *name, const char *help) {
  return prometheus::BuildGauge().Name(name).Help(help).Register(registry).Add({});
}

template <class T> double number_at(const std::byte *at) {
  T out;
  std::memcpy(&out, at, sizeof out);
  return static_cast<double>(out);
}

std::string text_at(const std::byte *at, std::size_t size) {
  const auto *text = reinterpret_cast<const char *>(at);
  return {text, strnlen(text, size)};
}

using Families = std::map<std::string, prometheus::MetricFamily>;

// Every single number of the record is a gauge, labelled with the record's key.
void add_record(Families &families, const RecordLayout &layout, std::span<const std::byte> record) {
  const std::byte *body = record.data() + sizeof(RecordHeader);
  std::vector<prometheus::ClientMetric::Label> labels;
  for (const FieldLayout &field : layout.fields) {
    if (field.key && field.type == FieldType::kChars) {
      labels.push_back({std::string(field.name), text_at(body + field.offset, field.count)});
    }
  }
  for (const FieldLayout &field : layout.fields) {
    if (field.key || field.count != 1 || field.type == FieldType::kChars || field.name == "reserved") {
      continue;
    }
    const std::byte *at = body + field.offset;
    prometheus::ClientMetric metric;
    metric.label = labels;
    metric.gauge.value = field.type == FieldType::kF64   ? number_at<double>(at)
                         : field.type == FieldType::kU32 ? number_at<std::uint32_t>(at)
                                                         : number_at<std::int32_t>(at);
    const std::string name = "bregma_" + std::string(layout.name) + "_" + std::string(field.name);
    prometheus::MetricFamily &family = families[name];
    family.name = name;
    family.help = std::string(field.text);
    family.type = prometheus::MetricType::Gauge;
    family.metric.push_back(std::move(metric));
  }
}

} // namespace

Metrics::Metrics()
    : connections(counter(registry, "bregma_gateway_connections_total", "connections accepted")),
      refused_connections(
          counter(registry, "bregma_gateway_refused_connections_total", "connections above the limit, closed at once")),
      open_connections(gauge(registry, "bregma_gateway_open_connections", "connections that are open")),
      watchers(gauge(registry, "bregma_gateway_watchers", "sockets of /state that are open")),
      frames(counter(registry, "bregma_gateway_frames_total", "frames written")),
      frame_bytes(counter(registry, "bregma_gateway_frame_bytes_total", "bytes of these frames")),
      closed_slow(counter(registry, "bregma_gateway_closed_slow_total", "sockets that took nothing for 2 s")),
      closed_bad(counter(registry, "bregma_gateway_closed_bad_total", "sockets closed for an invalid message")),
      written_s(prometheus::BuildHistogram()
                    .Name("bregma_gateway_sample_to_socket_seconds")
                    .Help("a sample of a tool taken from DDS, until the socket has taken its frame")
                    .Register(registry)
                    .Add({}, prometheus::Histogram::BucketBoundaries{0.00005, 0.0001, 0.00015, 0.0002, 0.0003, 0.0005,
                                                                     0.00075, 0.001, 0.0015, 0.002, 0.003, 0.005, 0.01,
                                                                     0.02, 0.05, 0.1, 0.5, 2.0})),
      answers_(prometheus::BuildCounter()
                   .Name("bregma_gateway_answers_total")
                   .Help("answers to requests, by status")
                   .Register(registry)) {}

void Metrics::count_answer(int status) { answers_.Add({{"status", std::to_string(status)}}).Increment(); }

std::string Metrics::text(const RecordStore &store) const {
  Families families;
  constexpr std::array kShown{RecordKind::kLink,   RecordKind::kSession,  RecordKind::kHealth,
                              RecordKind::kDevice, RecordKind::kLoop,     RecordKind::kAlarm,
                              RecordKind::kTool,   RecordKind::kAccuracy, RecordKind::kRegistration};
  for (const RecordKind kind : kShown) {
    const RecordLayout &layout = *find_layout(static_cast<std::uint16_t>(kind));
    store.each(kind, [&](std::span<const std::byte> record) { add_record(families, layout, record); });
  }
  std::vector<prometheus::MetricFamily> all = registry.Collect();
  for (auto &[name, family] : families) {
    all.push_back(std::move(family));
  }
  return prometheus::TextSerializer().Serialize(all);
}

} // namespace bregma::gateway
