#include "clients/gateway/answer.hpp"

#include <fstream>

#include <gtest/gtest.h>

#include "tests/support/temporary_folder.hpp"

namespace bregma::gateway {
namespace {

const std::string kHash(64, 'a');
constexpr const char *kToken = "0123456789abcdef";

Site site(std::string token = {}) {
  Site out;
  out.access = make_access(true, false, 8310, {}, std::move(token));
  out.page["/index.html"] = std::make_shared<const std::string>("page");
  out.page["/app.js"] = std::make_shared<const std::string>("script");
  out.sources.case_json = [] { return std::optional<std::string>("{}"); };
  out.sources.case_file = [](std::string_view hash, std::string_view name) {
    return hash == kHash && name == "image" ? std::optional<std::filesystem::path>("/image") : std::nullopt;
  };
  out.sources.metrics = [] { return std::string("metrics"); };
  return out;
}

Query get(std::string_view target) { return {"GET", target, "localhost:8310", {}, {}, {}, false}; }

Answer plain(const Site &asked, const Query &query) {
  auto out = answer(asked, query);
  return std::holds_alternative<Answer>(out) ? std::get<Answer>(out) : Answer{};
}

std::string text(const Answer &answer) { return *std::get<std::shared_ptr<const std::string>>(answer.body); }

TEST(AnswerTest, ThePageItsFilesTheCaseAndTheMetrics) {
  EXPECT_EQ(text(plain(site(), get("/"))), "page");
  EXPECT_EQ(plain(site(), get("/")).type, "text/html; charset=utf-8");
  EXPECT_EQ(plain(site(), get("/app.js?v=1")).type, "text/javascript");
  EXPECT_EQ(text(plain(site(), get("/case"))), "{}");
  EXPECT_EQ(text(plain(site(), get("/metrics"))), "metrics");
  const Answer image = plain(site(), get("/case/" + kHash + "/image"));
  EXPECT_EQ(std::get<std::filesystem::path>(image.body), "/image");
  EXPECT_TRUE(image.immutable);
}

TEST(AnswerTest, WhatIsNotThereIsNotFound) {
  for (const std::string &target :
       {std::string("/../etc/passwd"), std::string("/%2e%2e/etc/passwd"), std::string("//"), std::string("x"),
        std::string(), std::string("/case/"), "/case/" + kHash, "/case/" + kHash + "/", "/case/" + kHash + "/other",
        "/case/" + std::string(64, 'z') + "/image", std::string("/patient")}) {
    EXPECT_EQ(plain(site(), get(target)).status, 404) << target;
  }
}

TEST(AnswerTest, AnotherHostAnotherOriginAndAnotherMethodAreRefused) {
  Query query = get("/case");
  query.host = "evil.example:8310";
  EXPECT_EQ(plain(site(), query).status, 403);
  query.host = {};
  EXPECT_EQ(plain(site(), query).status, 403);
  query.host = "LOCALHOST:8310";
  EXPECT_EQ(plain(site(), query).status, 200);
  query.origin = "http://evil.example";
  EXPECT_EQ(plain(site(), query).status, 403);
  query.origin = "null";
  EXPECT_EQ(plain(site(), query).status, 403);
  query.origin = "http://localhost:8310";
  EXPECT_EQ(plain(site(), query).status, 200);
  query.method = "POST";
  EXPECT_EQ(plain(site(), query).status, 405);
}

TEST(AnswerTest, ThePageOfAnotherOriginCannotOpenTheSocket) {
  Query query = get("/state");
  query.upgrade = true;
  EXPECT_TRUE(std::holds_alternative<Stream>(answer(site(), query)));
  query.origin = "http://localhost:8310";
  EXPECT_TRUE(std::holds_alternative<Stream>(answer(site(), query)));
  query.origin = "http://localhost:9999";
  EXPECT_EQ(plain(site(), query).status, 403);
}

TEST(AnswerTest, TheFormatOfTheStream) {
  Query query = get("/state?format=json");
  EXPECT_EQ(plain(site(), query).status, 426);
  query.upgrade = true;
  EXPECT_TRUE(std::get<Stream>(answer(site(), query)).json);
  query.target = "/state?format=binary";
  EXPECT_FALSE(std::get<Stream>(answer(site(), query)).json);
}

TEST(AnswerTest, WithoutTheTokenNothingIsServed) {
  const Site closed = site(kToken);
  for (const std::string &target :
       {std::string("/"), std::string("/app.js"), std::string("/case"), "/case/" + kHash + "/image",
        std::string("/state"), std::string("/metrics"), std::string("/patient"), std::string("/?token=wrong"),
        std::string("/case?token=0123456789abcdef")}) {
    Query query = get(target);
    query.upgrade = target == "/state";
    EXPECT_EQ(plain(closed, query).status, 401) << target;
  }
  Query query = get("/case");
  query.authorization = "Bearer 0123456789abcdeX";
  EXPECT_EQ(plain(closed, query).status, 401);
  query.authorization = "Bearer 0123456789abcdef";
  EXPECT_EQ(plain(closed, query).status, 200);
  query.authorization = {};
  query.cookie = "other=1; bregma_token=0123456789abcdef";
  EXPECT_EQ(plain(closed, query).status, 200);
}

TEST(AnswerTest, TheTokenInTheAddressBecomesACookieAndLeavesTheAddress) {
  const Answer redirect = plain(site(kToken), get("/?token=0123456789abcdef"));
  EXPECT_EQ(redirect.status, 303);
  ASSERT_EQ(redirect.headers.size(), 2U);
  EXPECT_EQ(redirect.headers[0].second, "/");
  EXPECT_NE(redirect.headers[1].second.find("HttpOnly; SameSite=Strict"), std::string::npos);
}

TEST(AnswerTest, SecretsAreComparedWhole) {
  EXPECT_TRUE(same_secret("abc", "abc"));
  EXPECT_FALSE(same_secret("ab", "abc"));
  EXPECT_FALSE(same_secret("abcd", "abc"));
  EXPECT_FALSE(same_secret("", "abc"));
}

TEST(AnswerTest, ThePageIsReadFromItsFolder) {
  const test::TemporaryFolder folder;
  std::filesystem::create_directory(folder.path() / "fonts");
  std::ofstream(folder.path() / "index.html") << "page";
  std::ofstream(folder.path() / "fonts" / "a.woff2") << "font";
  const auto files = read_page(folder.path());
  ASSERT_TRUE(files);
  ASSERT_EQ(files->size(), 2U);
  EXPECT_EQ(*files->at("/fonts/a.woff2"), "font");
  EXPECT_TRUE(read_page(folder.path() / "missing")->empty());
}

} // namespace
} // namespace bregma::gateway
