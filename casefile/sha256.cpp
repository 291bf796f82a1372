#include "casefile/sha256.hpp"

#include <fstream>
#include <memory>
#include <vector>

#include <openssl/evp.h>

namespace bregma::casefile {
namespace {

class Digest {
public:
  Digest() : context_(EVP_MD_CTX_new(), &EVP_MD_CTX_free) { EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr); }
  void add(const void *bytes, std::size_t size) { EVP_DigestUpdate(context_.get(), bytes, size); }
  Hash result() {
    Hash out{};
    EVP_DigestFinal_ex(context_.get(), out.data(), nullptr);
    return out;
  }

private:
  std::unique_ptr<EVP_MD_CTX, decltype(&EVP_MD_CTX_free)> context_;
};

constexpr std::size_t kPart = std::size_t{1} << 20;

} // namespace

Hash sha256(std::span<const std::byte> bytes) {
  Digest digest;
  digest.add(bytes.data(), bytes.size());
  return digest.result();
}

Hash sha256(std::string_view text) { return sha256(std::as_bytes(std::span(text))); }

base::Result<Hash> sha256_of_file(const std::filesystem::path &file) {
  std::ifstream in(file, std::ios::binary);
  Digest digest;
  std::vector<char> part(kPart);
  while (in) {
    in.read(part.data(), static_cast<std::streamsize>(part.size()));
    digest.add(part.data(), static_cast<std::size_t>(in.gcount()));
  }
  if (!in.eof()) {
    return base::failure(file.string() + ": cannot be read");
  }
  return digest.result();
}

std::string to_hex(const Hash &hash) {
  constexpr std::string_view kDigits = "0123456789abcdef";
  std::string out;
  for (const std::uint8_t byte : hash) {
    out += kDigits[byte >> 4];
    out += kDigits[byte & 15];
  }
  return out;
}

std::optional<Hash> from_hex(std::string_view text) {
  Hash out{};
  if (text.size() != 2 * out.size()) {
    return std::nullopt;
  }
  const auto digit = [](char c) {
    return c >= '0' && c <= '9'   ? c - '0'
           : c >= 'a' && c <= 'f' ? c - 'a' + 10
           : c >= 'A' && c <= 'F' ? c - 'A' + 10
                                  : -1;
  };
  for (std::size_t i = 0; i < out.size(); ++i) {
    const int high = digit(text[2 * i]);
    const int low = digit(text[2 * i + 1]);
    if (high < 0 || low < 0) {
      return std::nullopt;
    }
    out[i] = static_cast<std::uint8_t>(16 * high + low);
  }
  return out;
}

} // namespace bregma::casefile
