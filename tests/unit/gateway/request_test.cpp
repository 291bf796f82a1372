#include "clients/gateway/request.hpp"

#include <cmath>

#include <gtest/gtest.h>

namespace bregma::gateway {
namespace {

std::optional<Request> parse(const Request &request) { return parse_request(std::as_bytes(std::span(&request, 1))); }

TEST(RequestTest, EachKindInBothForms) {
  const auto both = [](const Request &binary, std::string_view json) {
    for (const auto &request : {parse(binary), parse_json_request(json)}) {
      ASSERT_TRUE(request) << json;
      EXPECT_EQ(request->kind, binary.kind);
      EXPECT_EQ(request->value, binary.value);
      EXPECT_EQ(request->client_ms, binary.client_ms);
    }
  };
  both({1, 7, 0.0}, R"({"ack": 7})");
  both({2, 30, 0.0}, R"({"rate": 30})");
  both({3, 0, 1.5}, R"({"ping": 1.5})");
  both({4, 1, 0.0}, R"({"field": 1})");
  both({5, 1, 0.0}, R"({"slices": 1})");
}

TEST(RequestTest, EverythingElseIsRefused) {
  for (const Request &request : {Request{0, 1, 0.0}, Request{6, 1, 0.0}, Request{2, 0, 0.0}, Request{2, 61, 0.0},
                                 Request{3, 0, NAN}, Request{3, 0, INFINITY}}) {
    EXPECT_FALSE(parse(request)) << request.kind << " " << request.value;
  }
  const Request good{1, 1, 0.0};
  const auto bytes = std::as_bytes(std::span(&good, 1));
  EXPECT_FALSE(parse_request(bytes.first(15)));
  EXPECT_FALSE(parse_request({}));
  for (const std::string_view json :
       {"", "{", "[]", "7", "{}", R"({"ack": "7"})", R"({"ack": -1})", R"({"ack": 1.5})", R"({"ack": 1e300})",
        R"({"load": 1})", R"({"ack": 1, "rate": 2})", R"({"rate": 0})"}) {
    EXPECT_FALSE(parse_json_request(json)) << json;
  }
  EXPECT_FALSE(parse_json_request(std::string(kMaxRequestBytes, ' ') + R"({"ack": 7})"));
}

} // namespace
} // namespace bregma::gateway
