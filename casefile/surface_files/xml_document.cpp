#include "casefile/surface_files/xml_document.hpp"

#include <limits>
#include <memory>

#include <expat.h>

namespace bregma::casefile::detail {

namespace {

constexpr std::size_t kDeepest = 64;

struct TreeBuilder {
  XML_Parser parser = nullptr;
  std::vector<XmlElement> open; // from the outermost to the current one
  XmlElement root;
  std::string problem;

  void stop(std::string why) {
    problem = std::move(why);
    XML_StopParser(parser, XML_FALSE);
  }

  static void start(void *self, const char *name, const char **attributes) {
    auto &builder = *static_cast<TreeBuilder *>(self);
    if (builder.open.size() == kDeepest) {
      builder.stop("elements are nested more than 64 deep");
      return;
    }
    XmlElement element;
    element.name = name;
    element.line = static_cast<int>(XML_GetCurrentLineNumber(builder.parser));
    for (const char **at = attributes; *at != nullptr; at += 2) {
      element.attributes.emplace(at[0], at[1]);
    }
    builder.open.push_back(std::move(element));
  }

  static void end(void *self, const char * /*name*/) {
    auto &builder = *static_cast<TreeBuilder *>(self);
    XmlElement element = std::move(builder.open.back());
    builder.open.pop_back();
    if (builder.open.empty()) {
      builder.root = std::move(element);
    } else {
      builder.open.back().children.push_back(std::move(element));
    }
  }

  static void characters(void *self, const char *text, int size) {
    auto &builder = *static_cast<TreeBuilder *>(self);
    if (!builder.open.empty()) {
      builder.open.back().text.append(text, static_cast<std::size_t>(size));
    }
  }

  static void entity(void *self, const char *name, int, const char *, int, const char *, const char *, const char *,
                     const char *) {
    static_cast<TreeBuilder *>(self)->stop("the file declares an entity (" + std::string(name) +
                                           "), which is not read");
  }
};

} // namespace

const XmlElement *XmlElement::child(std::string_view wanted) const {
  for (const XmlElement &element : children) {
    if (element.name == wanted) {
      return &element;
    }
  }
  return nullptr;
}

std::string_view XmlElement::attribute(std::string_view key) const {
  const auto found = attributes.find(key);
  return found == attributes.end() ? std::string_view() : std::string_view(found->second);
}

Parsed<XmlElement> parse_xml(std::string_view content) {
  const std::unique_ptr<std::remove_pointer_t<XML_Parser>, decltype(&XML_ParserFree)> parser(XML_ParserCreate(nullptr),
                                                                                             &XML_ParserFree);
  TreeBuilder builder;
  builder.parser = parser.get();
  XML_SetUserData(parser.get(), &builder);
  XML_SetElementHandler(parser.get(), &TreeBuilder::start, &TreeBuilder::end);
  XML_SetCharacterDataHandler(parser.get(), &TreeBuilder::characters);
  XML_SetEntityDeclHandler(parser.get(), &TreeBuilder::entity);
  if (content.size() > static_cast<std::size_t>(std::numeric_limits<int>::max())) {
    return wrong("is larger than 2 GB");
  }
  if (XML_Parse(parser.get(), content.data(), static_cast<int>(content.size()), XML_TRUE) != XML_STATUS_OK) {
    const auto line = static_cast<int>(XML_GetCurrentLineNumber(parser.get()));
    return wrong_line(line, builder.problem.empty()
                                ? std::string("is not whole XML: ") + XML_ErrorString(XML_GetErrorCode(parser.get()))
                                : builder.problem);
  }
  return std::move(builder.root);
}

} // namespace bregma::casefile::detail
