// A gateway outside loopback: TLS with the site's certificate, and a token.
#include <cstdio>
#include <memory>
#include <string>
#include <thread>

#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/ssl/context.hpp>
#include <boost/asio/ssl/stream.hpp>
#include <boost/asio/write.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509.h>

#include "clients/gateway/server.hpp"
#include "tests/support/temporary_folder.hpp"
#include "tests/unit/gateway/socket_client.hpp"

namespace bregma::gateway {
namespace {

namespace asio = boost::asio;
namespace http = boost::beast::http;

constexpr const char *kToken = "0123456789abcdef";

// A key and a certificate that signs itself, for localhost.
void write_certificate(const test::TemporaryFolder &folder) {
  const std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)> key(EVP_EC_gen("P-256"), &EVP_PKEY_free);
  const std::unique_ptr<X509, decltype(&X509_free)> certificate(X509_new(), &X509_free);
  ASN1_INTEGER_set(X509_get_serialNumber(certificate.get()), 1);
  X509_gmtime_adj(X509_getm_notBefore(certificate.get()), -60);
  X509_gmtime_adj(X509_getm_notAfter(certificate.get()), 3600);
  X509_set_pubkey(certificate.get(), key.get());
  X509_NAME *name = X509_get_subject_name(certificate.get());
  X509_NAME_add_entry_by_txt(name, "CN", MBSTRING_ASC, reinterpret_cast<const unsigned char *>("localhost"), -1, -1, 0);
  X509_set_issuer_name(certificate.get(), name);
  ASSERT_NE(X509_sign(certificate.get(), key.get(), EVP_sha256()), 0);
  const auto file = [&](const char *as) { return std::fopen((folder / as).c_str(), "w"); };
  std::FILE *out = file("site.key");
  PEM_write_PrivateKey(out, key.get(), nullptr, nullptr, 0, nullptr, nullptr);
  std::fclose(out);
  out = file("site.pem");
  PEM_write_X509(out, certificate.get());
  std::fclose(out);
}

class Tls : public ::testing::Test {
protected:
  Tls() {
    write_certificate(folder_);
    auto opened =
        Server::open(io_, shared_, {.port = 0, .certificate = folder_ / "site.pem", .key = folder_ / "site.key"});
    EXPECT_TRUE(opened) << opened.error().message;
    server_ = std::move(*opened);
    shared_->site.access = make_access(false, true, server_->port(), {"display.example"}, kToken);
    shared_->site.page["/index.html"] = std::make_shared<const std::string>("page");
    thread_ = std::thread([this] { io_.run(); });
  }
  ~Tls() override {
    io_.stop();
    thread_.join();
  }

  http::response<http::string_body> get(const std::string &target, const std::string &token,
                                        const std::string &host = "display.example") {
    asio::io_context io;
    asio::ssl::context tls(asio::ssl::context::tls_client);
    tls.load_verify_file((folder_ / "site.pem").string());
    tls.set_verify_mode(asio::ssl::verify_peer);
    asio::ssl::stream<asio::ip::tcp::socket> stream(test::connect_to(io, server_->port()), tls);
    stream.handshake(asio::ssl::stream_base::client);
    http::request<http::empty_body> request(http::verb::get, target, 11);
    request.set(http::field::host, host + ":" + std::to_string(server_->port()));
    if (!token.empty()) {
      request.set(http::field::authorization, "Bearer " + token);
    }
    http::write(stream, request);
    boost::beast::flat_buffer buffer;
    http::response<http::string_body> response;
    http::read(stream, buffer, response);
    return response;
  }

  test::TemporaryFolder folder_;
  asio::io_context io_{1};
  std::shared_ptr<Shared> shared_ = std::make_shared<Shared>();
  std::unique_ptr<Server> server_;
  std::thread thread_;
};

TEST_F(Tls, WithTheTokenThePageIsServedAndWithoutItNothing) {
  EXPECT_EQ(get("/", kToken).body(), "page");
  EXPECT_EQ(get("/", {}).result_int(), 401U);
  EXPECT_EQ(get("/", "0123456789abcdeX").result_int(), 401U);
  EXPECT_EQ(get("/metrics", {}).result_int(), 401U);
  EXPECT_EQ(get("/", kToken, "localhost").result_int(), 403U) << "loopback's names are not its own";
  const auto redirect = get("/?token=" + std::string(kToken), {});
  EXPECT_EQ(redirect.result_int(), 303U);
  EXPECT_NE(redirect["Set-Cookie"].find("Secure"), boost::beast::string_view::npos);
}

TEST_F(Tls, WhoSpeaksPlainHttpGetsNothing) {
  asio::io_context io;
  auto socket = test::connect_to(io, server_->port());
  asio::write(socket, asio::buffer(std::string("GET / HTTP/1.1\r\nHost: display.example\r\n\r\n")));
  std::string received(256, '\0');
  boost::system::error_code failed;
  const std::size_t bytes = socket.read_some(asio::buffer(received), failed);
  received.resize(bytes);
  EXPECT_EQ(received.find("HTTP"), std::string::npos);
}

} // namespace
} // namespace bregma::gateway
