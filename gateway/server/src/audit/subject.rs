//! What a request is about, read from its bytes by the names of its fields: every request of the contract that has a
//! `case_id` means the same by it, those that are still to be written too.

use std::collections::{HashMap, HashSet};

use prost::Message as _;
use prost_types::field_descriptor_proto::Type;
use prost_types::{DescriptorProto, FileDescriptorSet};

use crate::approval::Digest;

/// How deep a field may lie: the header of an upload is one message down.
const DEPTH_MOST: usize = 2;

/// What a request is about; empty where it does not say.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Subject {
    /// Field `case_id`.
    pub case_id: String,
    /// Field `procedure_id`.
    pub procedure_id: String,
    /// Field `operator` or `surgeon`: who is said to act.
    pub stated: String,
    /// Field `plan_digest`.
    pub plan: Option<Digest>,
    /// Field `reason`.
    pub reason: String,
}

/// The requests of every method of the contract.
#[derive(Debug, Default)]
pub struct Requests {
    methods: HashMap<String, Method>,
    messages: HashMap<String, HashMap<u32, Field>>,
}

#[derive(Debug)]
struct Method {
    request: String,
    streams: bool,
}

#[derive(Clone, Debug)]
enum Field {
    Text(Meaning),
    Message(String),
}

#[derive(Clone, Copy, Debug)]
enum Meaning {
    CaseId,
    ProcedureId,
    Stated,
    PlanDigest,
    Reason,
}

// === impl Requests ===

impl Requests {
    /// From the contract's own description.
    pub fn of_the_contract() -> Self {
        let mut requests = Self::default();
        // The description is compiled in beside the code that was made from it.
        let Ok(files) = FileDescriptorSet::decode(arthro_proto::DESCRIPTORS) else {
            return requests;
        };
        for file in &files.file {
            let package = file.package();
            for message in &file.message_type {
                requests.add_message(package, message);
            }
            for service in &file.service {
                for method in &service.method {
                    let path = format!("/{package}.{}/{}", service.name(), method.name());
                    let request = method.input_type().trim_start_matches('.').to_owned();
                    let streams = method.client_streaming();
                    requests.methods.insert(path, Method { request, streams });
                }
            }
        }
        requests
    }

    fn add_message(&mut self, scope: &str, message: &DescriptorProto) {
        let name = format!("{scope}.{}", message.name());
        for inner in &message.nested_type {
            self.add_message(&name, inner);
        }
        let mut fields = HashMap::new();
        for field in &message.field {
            let number = field.number().unsigned_abs();
            let kept = match field.r#type() {
                Type::Message => {
                    Field::Message(field.type_name().trim_start_matches('.').to_owned())
                }
                Type::String => match Meaning::of(field.name()) {
                    Some(meaning) => Field::Text(meaning),
                    None => continue,
                },
                _ => continue,
            };
            fields.insert(number, kept);
        }
        self.messages.insert(name, fields);
    }

    /// Whether the client sends more than one message.
    pub fn streams(&self, path: &str) -> bool {
        self.methods.get(path).is_some_and(|method| method.streams)
    }

    /// What the first message of a call's body is about.
    pub fn subject(&self, path: &str, body: &[u8]) -> Subject {
        let mut subject = Subject::default();
        let Some(method) = self.methods.get(path) else {
            return subject;
        };
        // Five bytes before each message: 0 for not compressed, and its length.
        let Some((&[0, a, b, c, d], rest)) = body.split_first_chunk::<5>() else {
            return subject;
        };
        let length = u32::from_be_bytes([a, b, c, d]) as usize;
        let message = rest.get(..length).unwrap_or(rest);
        self.scan(&method.request, message, DEPTH_MOST, &mut subject);
        subject
    }

    /// Stops at the first thing that is no field: the handler says what is wrong with it.
    fn scan(&self, message: &str, mut bytes: &[u8], depth: usize, subject: &mut Subject) {
        let Some(fields) = self.messages.get(message) else {
            return;
        };
        while let Some(((number, value), rest)) = next_field(bytes) {
            bytes = rest;
            let Some(value) = value else {
                continue;
            };
            match fields.get(&number) {
                Some(Field::Text(meaning)) => {
                    if let Ok(text) = std::str::from_utf8(value) {
                        subject.put(*meaning, text);
                    }
                }
                Some(Field::Message(inner)) if depth > 1 => {
                    self.scan(inner, value, depth - 1, subject);
                }
                _ => {}
            }
        }
    }

    /// The methods of the contract.
    pub fn methods(&self) -> HashSet<&str> {
        self.methods.keys().map(String::as_str).collect()
    }
}

// === impl Subject ===

impl Subject {
    fn put(&mut self, meaning: Meaning, text: &str) {
        match meaning {
            Meaning::CaseId => self.case_id = text.to_owned(),
            Meaning::ProcedureId => self.procedure_id = text.to_owned(),
            Meaning::Stated => self.stated = text.to_owned(),
            Meaning::PlanDigest => self.plan = Digest::parse(text),
            Meaning::Reason => self.reason = text.to_owned(),
        }
    }
}

// === impl Meaning ===

impl Meaning {
    fn of(name: &str) -> Option<Self> {
        match name {
            "case_id" => Some(Self::CaseId),
            "procedure_id" => Some(Self::ProcedureId),
            "operator" | "surgeon" | "person" => Some(Self::Stated),
            "plan_digest" => Some(Self::PlanDigest),
            "reason" => Some(Self::Reason),
            _ => None,
        }
    }
}

/// A field's number, and its bytes if it has a length.
type FieldBytes<'a> = (u32, Option<&'a [u8]>);

/// The next field, and what follows it.
fn next_field(bytes: &[u8]) -> Option<(FieldBytes<'_>, &[u8])> {
    let (tag, rest) = varint(bytes)?;
    let number = u32::try_from(tag >> 3).ok()?;
    match tag & 7 {
        0 => Some(((number, None), varint(rest)?.1)),
        1 => Some(((number, None), rest.get(8..)?)),
        2 => {
            let (length, rest) = varint(rest)?;
            let (value, rest) = rest.split_at_checked(usize::try_from(length).ok()?)?;
            Some(((number, Some(value)), rest))
        }
        5 => Some(((number, None), rest.get(4..)?)),
        _ => None,
    }
}

fn varint(bytes: &[u8]) -> Option<(u64, &[u8])> {
    let mut value = 0_u64;
    for (index, byte) in bytes.iter().take(10).enumerate() {
        value |= u64::from(byte & 0x7f).checked_shl(7 * index as u32)?;
        if byte & 0x80 == 0 {
            return Some((value, &bytes[index + 1..]));
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use arthro_proto::gateway::v1 as proto;
    use proptest::prelude::*;

    fn framed(message: &impl prost::Message) -> Vec<u8> {
        let encoded = message.encode_to_vec();
        let mut body = vec![0];
        body.extend((encoded.len() as u32).to_be_bytes());
        body.extend(encoded);
        body
    }

    #[test]
    fn an_approval_is_about_its_case_plan_and_surgeon() {
        let digest = Digest::from_bytes([7; 32]);
        let request = proto::ApprovePlanRequest {
            case_id: "c1".to_owned(),
            plan_digest: digest.to_string(),
            surgeon: "Dr. Adams".to_owned(),
        };
        let requests = Requests::of_the_contract();
        let path = "/arthro.gateway.v1.CaseService/ApprovePlan";
        let subject = requests.subject(path, &framed(&request));
        assert_eq!(subject.case_id, "c1");
        assert_eq!(subject.stated, "Dr. Adams");
        assert_eq!(subject.plan, Some(digest));
        assert!(!requests.streams(path));
    }

    #[test]
    fn an_upload_is_about_the_case_of_its_header() {
        let header = proto::ModelHeader {
            case_id: "c1".to_owned(),
            ..Default::default()
        };
        let request = proto::UploadModelRequest {
            payload: Some(proto::upload_model_request::Payload::Header(header)),
        };
        let requests = Requests::of_the_contract();
        let path = "/arthro.gateway.v1.CaseService/UploadModel";
        assert_eq!(requests.subject(path, &framed(&request)).case_id, "c1");
        assert!(requests.streams(path));
    }

    proptest! {
        #[test]
        fn any_bytes_are_read_without_harm(body: Vec<u8>) {
            let requests = Requests::of_the_contract();
            let mut framed = vec![0, 0, 0, 1, 0];
            framed.extend(&body);
            for path in requests.methods() {
                requests.subject(path, &body);
                requests.subject(path, &framed);
            }
        }
    }
}
