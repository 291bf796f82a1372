// The installed package in another project: installed to a separate folder. A driver and a client are built from the
// installed examples, outside the tree, and run with the installed daemon.
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "tests/support/force_lines.hpp"
#include "tests/support/process.hpp"
#include "tests/support/tcp_device.hpp"
#include "tests/support/temporary_folder.hpp"

namespace bregma::test {
namespace {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

std::string read_file(const fs::path &file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

bool holds(const std::string &text, const std::string &part) { return text.find(part) != std::string::npos; }

// The force sensor: 200 lines per second, every tenth with a wrong checksum.
class ForceSensor {
public:
  ForceSensor()
      : thread_([this] {
          while (!stop_) {
            if (device_.accept(100ms)) {
              while (!stop_ && device_.send(next_line())) {
                std::this_thread::sleep_for(5ms);
              }
            }
          }
        }) {}
  ~ForceSensor() {
    stop_ = true;
    thread_.join();
  }
  ForceSensor(const ForceSensor &) = delete;
  ForceSensor &operator=(const ForceSensor &) = delete;
  [[nodiscard]] std::string address() const { return device_.address(); }

private:
  std::string next_line() {
    const auto time_us =
        std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::steady_clock::now() - start_);
    std::string line =
        force_line_of("FRC," + std::to_string(count_) + "," + std::to_string(time_us.count()) + ",100,-200,300");
    if (++count_ % 10 == 0) {
      line.back() = line.back() == '0' ? '1' : '0';
    }
    return line + "\r\n";
  }

  TcpDevice device_;
  std::chrono::steady_clock::time_point start_ = std::chrono::steady_clock::now();
  std::uint64_t count_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_; // last, because it uses the others
};

class Sdk : public testing::Test {
protected:
  static void SetUpTestSuite() {
    folder_ = new TemporaryFolder;
    run("cmake --install '" BREGMA_BINARY_DIR "' --prefix '" + prefix().string() + "'");
    for (const char *example : {"new_driver", "new_client"}) {
      const std::string build = (*folder_ / example).string();
      run("cmake -G Ninja -DCMAKE_BUILD_TYPE=Release -DCMAKE_PREFIX_PATH='" + prefix().string() + "' -B '" + build +
          "' '" + (doc() / "examples" / example).string() + "' && cmake --build '" + build + "'");
    }
  }
  static void TearDownTestSuite() {
    delete folder_;
    folder_ = nullptr;
  }
  void SetUp() override { ASSERT_EQ(failed_, "") << read_file(log("build")); }

  static fs::path prefix() { return *folder_ / "prefix"; }
  static fs::path doc() { return prefix() / "share/doc/bregma"; }
  static fs::path log(const std::string &name) { return *folder_ / (name + ".log").c_str(); }
  static std::string program(const char *name) { return (prefix() / "bin" / name).string(); }
  static std::string example(const char *folder, const char *name) { return (*folder_ / folder / name).string(); }

private:
  static void run(const std::string &command) {
    const std::string whole = "(" + command + ") >>'" + log("build").string() + "' 2>&1 </dev/null";
    if (failed_.empty() && std::system(whole.c_str()) != 0) { // NOLINT(bugprone-command-processor,cert-env33-c)
      failed_ = command;
    }
  }
  static TemporaryFolder *folder_;
  static std::string failed_;
};

TemporaryFolder *Sdk::folder_ = nullptr;
std::string Sdk::failed_;

TEST_F(Sdk, AllFilesAreInstalled) {
  for (const char *file :
       {"bin/bregma", "bin/bregmad", "bin/bregma-sim-room", "bin/bregma-gateway", "bin/bregma-case-server",
        "include/bregma/idl/dds.hpp", "include/bregma/algorithms/geometry/rigid3.hpp",
        "include/bregma/drivers/frame/program.hpp", "share/bregma/idl/streams.idl", "share/bregma/cyclonedds-local.xml",
        "share/bregma/bregma-limits.conf", "share/doc/bregma/LICENSE", "share/doc/bregma/docs/new-driver.md",
        "lib/sysusers.d/bregma.conf", "share/man/man1/bregmad.1", "share/man/man1/bregma-sim-room.1",
        "share/zsh/site-functions/_bregma"}) {
    EXPECT_TRUE(fs::is_regular_file(prefix() / file)) << file;
  }
  const std::string unit = read_file(prefix() / "lib/systemd/system/bregmad.service");
  EXPECT_TRUE(holds(unit, "ExecStart=" + program("bregmad") + " --config")) << unit;
  Process doctor({program("bregmad"), "--config", (prefix() / "share/bregma/bregmad.toml").string(), "--print-config"},
                 log("config").string());
  EXPECT_EQ(doctor.wait(30.0), 0) << doctor.log();
}

// The whole answer of a server on this host, headers included.
std::string answer_of(std::uint16_t port, const std::string &path) {
  const int socket = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  std::string out;
  if (connect(socket, reinterpret_cast<const sockaddr *>(&address), sizeof address) == 0) {
    const std::string request =
        "GET " + path + " HTTP/1.1\r\nHost: localhost:" + std::to_string(port) + "\r\nConnection: close\r\n\r\n";
    (void)send(socket, request.data(), request.size(), MSG_NOSIGNAL);
    char part[4096];
    for (ssize_t n = 0; (n = recv(socket, part, sizeof part, 0)) > 0;) {
      out.append(part, static_cast<std::size_t>(n));
    }
  }
  close(socket);
  return out;
}

TEST_F(Sdk, TheInstalledGatewayServesTheInstalledPage) {
  const fs::path page = prefix() / "share/bregma/display";
  if (!fs::exists(page)) {
    GTEST_SKIP() << "built without the page of the display";
  }
  Process gateway({program("bregma-gateway"), "--port", "0", "--domain", std::to_string(100 + getpid() % 100),
                   "--cache", (prefix() / "cache").string()},
                  log("gateway").string());
  unsigned long port = 0;
  for (int i = 0; i < 200 && port == 0; ++i) {
    std::this_thread::sleep_for(50ms);
    const std::string text = gateway.log();
    const std::size_t at = text.rfind("localhost:");
    port = at == std::string::npos ? 0 : std::strtoul(text.c_str() + at + 10, nullptr, 10);
  }
  ASSERT_NE(port, 0U) << gateway.log();
  for (const auto &[path, file] :
       {std::pair{"/", "index.html"}, {"/main.js", "main.js"}, {"/style.css", "style.css"}}) {
    const std::string answer = answer_of(static_cast<std::uint16_t>(port), path);
    const std::string content = read_file(page / file);
    EXPECT_TRUE(answer.starts_with("HTTP/1.1 200")) << path << ": " << answer.substr(0, 80);
    EXPECT_FALSE(content.empty()) << file;
    EXPECT_TRUE(answer.ends_with(content)) << file;
  }
  const std::string unit = read_file(prefix() / "lib/systemd/system/bregma-gateway.service");
  EXPECT_TRUE(holds(unit, "ExecStart=" + program("bregma-gateway") + " ")) << unit;
  EXPECT_TRUE(fs::is_regular_file(prefix() / "lib/systemd/system/bregma-kiosk.service"));
}

// The manual pages are made from --help during the installation. The test checks that they are complete.
TEST_F(Sdk, TheManualAgreesWithHelp) {
  const std::string page = read_file(prefix() / "share/man/man1/bregma-register-points.1");
  EXPECT_TRUE(holds(page, ".TH BREGMA-REGISTER-POINTS \"1\"")) << page;
  for (const char *command : {"bregma register points", "bregma watch", "bregmad", "bregma-sim-room"}) {
    std::vector<std::string> words;
    std::istringstream stream(command);
    std::string name;
    for (std::string word; stream >> word;) {
      words.push_back(words.empty() ? program(word.c_str()) : word);
      name += (name.empty() ? "" : "-") + word;
    }
    words.emplace_back("--help");
    Process help(words, log("help-" + name).string());
    ASSERT_EQ(help.wait(30.0), 0) << command;
    const std::string manual = read_file(prefix() / ("share/man/man1/" + name + ".1"));
    std::istringstream lines(help.log());
    int options = 0;
    for (std::string line; std::getline(lines, line);) {
      if (const std::size_t dashes = line.find("--"); dashes != std::string::npos && line.starts_with("  -")) {
        std::string option = line.substr(dashes + 2, line.find_first_of(" =", dashes + 2) - dashes - 2);
        for (std::size_t at = 0; (at = option.find('-', at)) != std::string::npos; at += 2) {
          option.replace(at, 1, "\\-"); // as troff writes it
        }
        EXPECT_TRUE(holds(manual, "\\-\\-" + option)) << name << ": --" << option;
        ++options;
      }
    }
    EXPECT_GE(options, 3) << command;
  }
}

TEST_F(Sdk, BashCompletesTheCommands) {
  const std::string script = (prefix() / "share/bash-completion/completions/bregma").string();
  Process shell({"/bin/bash", "-c",
                 "source '" + script +
                     "' && COMP_WORDS=(bregma reg) COMP_CWORD=1 && _bregma && echo \"completed ${COMPREPLY[*]}\""},
                log("completion").string());
  EXPECT_EQ(shell.wait(30.0), 0) << shell.log();
  EXPECT_EQ(shell.log(), "completed register\n");
}

TEST_F(Sdk, AnExampleDriverAndAnExampleClientWorkWithTheInstalledDaemon) {
  const std::string domain = std::to_string(100 + getpid() % 100);
  const fs::path state = log("state").replace_extension();
  Process daemon({program("bregmad"), "--set", "domain_id=" + domain, "--set", "state.directory=" + state.string()},
                 log("bregmad").string());
  ForceSensor sensor;
  Process driver({example("new_driver", "my-force"), "--domain", domain, "--set", "address=" + sensor.address()},
                 log("my-force").string());
  Process client({example("new_client", "my-client"), domain, "60"}, log("my-client").string());
  const auto end = std::chrono::steady_clock::now() + 50s; // limits a hang; not a measurement
  while (!holds(client.log(), "Force: live") && std::chrono::steady_clock::now() < end) {
    std::this_thread::sleep_for(100ms);
  }
  EXPECT_TRUE(holds(client.log(), "Force: live")) << client.log() << driver.log() << daemon.log();
  driver.signal(SIGTERM);
  EXPECT_EQ(driver.wait(20.0), 0) << driver.log();
  EXPECT_TRUE(holds(driver.log(), "unreadable (last: wrong checksum)")) << driver.log();
  daemon.signal(SIGTERM);
  EXPECT_EQ(daemon.wait(20.0), 0) << daemon.log();
}

TEST_F(Sdk, TheExamplesPrintTheirUsage) {
  Process help({example("new_driver", "my-force"), "--help"}, log("force-help").string());
  EXPECT_EQ(help.wait(30.0), 0);
  EXPECT_TRUE(holds(help.log(), "Examples:\n  my-force --set address=serial:///dev/ttyUSB0")) << help.log();
  Process wrong({example("new_driver", "my-force"), "--set", "address=ttyUSB0"}, log("force-wrong").string());
  EXPECT_EQ(wrong.wait(30.0), 2);
  EXPECT_TRUE(holds(wrong.log(), "address = ttyUSB0: must be tcp://HOST:PORT or serial:///DEVICE?baud=N"))
      << wrong.log();
  Process client({example("new_client", "my-client")}, log("client-wrong").string());
  EXPECT_EQ(client.wait(30.0), 2);
}

// The first line is required for communication with other programs.
TEST_F(Sdk, ThePageOnDriversBeginsWithTheSettingsOfCyclone) {
  const std::string page = read_file(doc() / "docs/new-driver.md");
  EXPECT_TRUE(holds(page.substr(0, page.find('\n')), "CYCLONEDDS_URI=file:///usr/share/bregma/cyclonedds-local.xml"));
}

} // namespace
} // namespace bregma::test
