#include "clients/cli/completion.hpp"

#include <functional>
#include <vector>

#include <CLI/App.hpp>
#include <CLI/Config.hpp>
#include <CLI/Formatter.hpp>

#include "clients/cli/output.hpp"

namespace bregma::cli {
namespace {

struct Word {
  std::string text; // a command or an option with its dashes
  std::string description;
};

// One node of the command tree and the words that may follow it.
struct Place {
  std::string path; // "", "/alarms", "/alarms/ack"
  std::vector<Word> words;
  std::vector<std::string> options_with_value;
};

std::vector<const CLI::App *> subcommands(const CLI::App &app) {
  return app.get_subcommands(std::function<bool(const CLI::App *)>());
}

void collect(const CLI::App &app, const std::string &path, std::vector<Place> &out) {
  Place place{path, {}, {}};
  for (const auto *command : subcommands(app)) {
    place.words.push_back({command->get_name(), command->get_description()});
  }
  for (const auto *option : app.get_options(std::function<bool(const CLI::Option *)>())) {
    for (const auto &name : option->get_lnames()) {
      place.words.push_back({"--" + name, option->get_description()});
      if (option->get_items_expected_max() > 0) {
        place.options_with_value.push_back("--" + name);
      }
    }
  }
  out.push_back(std::move(place));
  for (const auto *command : subcommands(app)) {
    collect(*command, path + "/" + command->get_name(), out);
  }
}

std::vector<Place> places_of(const CLI::App &program) {
  std::vector<Place> out;
  collect(program, "", out);
  return out;
}

// Quotes a text for a shell, in single quotes.
std::string shell_quoted(const std::string &text) {
  std::string out = "'";
  for (const char c : text) {
    out += c == '\'' ? std::string("'\\''") : c == '\n' ? std::string(" ") : std::string(1, c);
  }
  return out + "'";
}

// Shell code that stores the command typed so far in `at`. The variable names are the same in both shells.
std::string walk_case(const std::vector<Place> &places) {
  std::string pattern;
  for (const auto &place : places) {
    if (!place.path.empty()) {
      pattern += (pattern.empty() ? "" : "|") + place.path;
    }
  }
  return "    case \"$at/$word\" in\n      " + pattern + ") at=\"$at/$word\" ;;\n    esac\n";
}

std::string value_case(const std::vector<Place> &places) {
  std::string pattern;
  for (const auto &place : places) {
    for (const auto &option : place.options_with_value) {
      pattern += (pattern.empty() ? "" : "|") + place.path + ":" + option;
    }
  }
  return pattern;
}

} // namespace

std::string bash_completion(const CLI::App &program) {
  const auto places = places_of(program);
  const std::string &name = program.get_name();
  std::string out = "# Completion of " + name + " for bash: source <(" + name + " completion bash)\n";
  out += "_" + name + "() {\n  local at= word current=${COMP_WORDS[COMP_CWORD]} i\n";
  out += "  for ((i = 1; i < COMP_CWORD; i++)); do\n    word=${COMP_WORDS[i]}\n" + walk_case(places) + "  done\n";
  out += "  COMPREPLY=()\n  case \"$at:${COMP_WORDS[COMP_CWORD-1]}\" in\n    " + value_case(places) +
         ") return ;; # its value: a file name, by the shell's default\n  esac\n  local words=\n  case \"$at\" in\n";
  for (const auto &place : places) {
    std::string words;
    for (const auto &word : place.words) {
      words += (words.empty() ? "" : " ") + word.text;
    }
    out += "    " + shell_quoted(place.path) + ") words=" + shell_quoted(words) + " ;;\n";
  }
  out += "  esac\n  COMPREPLY=($(compgen -W \"$words\" -- \"$current\"))\n}\n";
  return out + "complete -o bashdefault -o default -F _" + name + " " + name + "\n";
}

std::string zsh_completion(const CLI::App &program) {
  const auto places = places_of(program);
  const std::string &name = program.get_name();
  std::string out = "#compdef " + name + "\n# Completion of " + name + " for zsh: " + name +
                    " completion zsh > a folder of $fpath, as _" + name + "\n";
  out += "_" + name + "() {\n  local at= word i\n  local -a choices\n";
  out += "  for ((i = 2; i < CURRENT; i++)); do\n    word=${words[i]}\n" + walk_case(places) + "  done\n";
  out += "  case \"$at:${words[CURRENT-1]}\" in\n    " + value_case(places) + ") _files; return ;;\n  esac\n";
  out += "  case \"$at\" in\n";
  for (const auto &place : places) {
    std::string choices;
    for (const auto &word : place.words) {
      choices += " " + shell_quoted(word.text + ":" + word.description);
    }
    out += "    " + shell_quoted(place.path) + ") choices=(" + choices + " ) ;;\n";
  }
  out += "  esac\n  _describe -t commands " + shell_quoted(name) + " choices\n  _files\n}\n";
  // Sourced, or put into $fpath and called.
  return out + "if [ \"$funcstack[1]\" = _" + name + " ]; then _" + name + " \"$@\"; else compdef _" + name + " " +
         name + "; fi\n";
}

void add_completion_command(CLI::App &app, Context &context) {
  auto *command = app.add_subcommand("completion", "Prints a completion script for a shell");
  command->require_subcommand(1);
  command->footer("Examples:\n  source <(bregma completion bash)\n"
                  "  bregma completion zsh > ~/.zfunc/_bregma");
  const auto add = [&](const char *shell, std::string (*make)(const CLI::App &)) {
    auto *one = command->add_subcommand(shell, std::string("For ") + shell);
    add_json_flag(*one, context);
    one->callback([make, &app, &context] {
      context.run = [make, &app, &context] {
        const std::string script = make(app);
        context.json ? print_json({{"script", script}}) : print(script);
        return kOk;
      };
    });
  };
  add("bash", bash_completion);
  add("zsh", zsh_completion);
}

} // namespace bregma::cli
