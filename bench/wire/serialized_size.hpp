// Serialized size of a sample, from Cyclone's internal functions, which only this benchmark uses.
#pragma once

#include <cstddef>

#include "idl/dds.hpp"

namespace bregma::bench {

// Bytes of the sample with its encapsulation header, without RTPS and UDP headers. Throws dds::Error.
[[nodiscard]] std::size_t serialized_size(const dds::Participant &participant, const dds_topic_descriptor_t &descriptor,
                                          const void *sample);

} // namespace bregma::bench
