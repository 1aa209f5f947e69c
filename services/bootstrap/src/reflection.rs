//! Which API a server has, told to `grpcurl` and to health checks.
//!
//! Reflection is mounted as v1 and v1alpha, because clients in use know only one of them each, and
//! carries the `google.rpc` descriptors, without which error details print as base64.

use prost::Message as _;
use prost_types::FileDescriptorSet;
use tonic::service::Routes;

use crate::BoxError;

/// Full names of the gRPC services in package `arthro.<name>.v1`.
pub(crate) fn services_of(name: &str) -> Result<Vec<String>, BoxError> {
    let package = format!("arthro.{name}.v1");
    let descriptors = FileDescriptorSet::decode(arthro_proto::DESCRIPTORS)?;
    Ok(descriptors
        .file
        .iter()
        .filter(|file| file.package() == package)
        .flat_map(|file| &file.service)
        .map(|service| format!("{package}.{}", service.name()))
        .collect())
}

/// Adds both versions of the reflection service to `routes`.
pub(crate) fn mount(routes: Routes, services: &[String]) -> Result<Routes, BoxError> {
    let builder = || {
        let builder = tonic_reflection::server::Builder::configure()
            .register_encoded_file_descriptor_set(arthro_proto::DESCRIPTORS)
            .register_encoded_file_descriptor_set(tonic_types::pb::FILE_DESCRIPTOR_SET)
            .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
            .with_service_name("grpc.health.v1.Health");
        services.iter().fold(builder, |builder, service| {
            builder.with_service_name(service)
        })
    };
    Ok(routes
        .add_service(builder().build_v1()?)
        .add_service(builder().build_v1alpha()?))
}
