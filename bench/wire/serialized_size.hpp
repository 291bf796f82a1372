// How large a sample is on the wire. Asks Cyclone itself, by means that nothing but this benchmark needs.
#pragma once

#include <cstddef>

#include "idl/dds.hpp"

namespace bregma::bench {

// Of the sample's own bytes with their encapsulation header, without RTPS and UDP headers. Throws dds::Error.
[[nodiscard]] std::size_t serialized_size(const dds::Participant &participant, const dds_topic_descriptor_t &descriptor,
                                          const void *sample);

} // namespace bregma::bench
