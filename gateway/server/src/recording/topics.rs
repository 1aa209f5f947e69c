//! The topics of a recording, and how their messages describe themselves: each with the part of our contract that defines it.

use std::collections::{BTreeMap, HashSet};

use prost::Message as _;
use prost_types::{FileDescriptorProto, FileDescriptorSet};

/// Declares a topic a line: variant, topic's name, full name of its messages.
macro_rules! topics {
    ($($(#[$doc:meta])* $topic:ident = $name:literal: $schema:literal,)*) => {
        /// One topic of a recording.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum Topic { $($(#[$doc])* $topic,)* }

        impl Topic {
            /// All of them, in the order of their channels.
            pub const ALL: &'static [Self] = &[$(Self::$topic,)*];

            /// As in the file.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$topic => $name,)* }
            }

            /// Full name of the topic's messages.
            pub const fn schema(self) -> &'static str {
                match self { $(Self::$topic => $schema,)* }
            }
        }
    };
}

topics! {
    /// What the file is: one line at its beginning.
    Recording = "/recording": "arthro.gateway.v1.RecordingHead",
    /// Every state of the procedure.
    Procedure = "/procedure": "arthro.gateway.v1.Procedure",
    /// Every state of every step.
    Step = "/step": "arthro.gateway.v1.Step",
    /// What each bite did.
    Bite = "/bite": "arthro.gateway.v1.BiteOutcome",
    /// Decisions, alarms, and what happened to the recording.
    Event = "/events": "arthro.gateway.v1.RecordedEvent",
    /// The arms' limits and portals, once a file.
    Cell = "/cell": "arthro.motion.v1.GetCellResponse",
    /// The axes' travels, once a file.
    AxisList = "/axis_list": "arthro.instrument.v1.ListAxesResponse",
    /// Both arms, measured.
    Arms = "/arms": "arthro.motion.v1.WatchStateResponse",
    /// All axes, measured.
    Axes = "/axes": "arthro.instrument.v1.WatchStateResponse",
    /// Where the frames are, for viewers.
    Transforms = "/tf": "foxglove.FrameTransforms",
    /// Shafts, portals and bites, for viewers.
    Scene = "/scene": "foxglove.SceneUpdate",
}

impl Topic {
    /// The topic with this name.
    pub fn parse(name: &str) -> Option<Self> {
        Self::ALL.iter().copied().find(|topic| topic.name() == name)
    }
}

/// Every topic's schema: an encoded `FileDescriptorSet` of the file that defines its messages and of all that it imports.
pub fn schemas() -> Result<BTreeMap<Topic, Vec<u8>>, prost::DecodeError> {
    let mut files = FileDescriptorSet::decode(arthro_proto::DESCRIPTORS)?.file;
    for file in &mut files {
        // The comments; a recording has its schemas twice, and readers need none.
        file.source_code_info = None;
    }
    Ok(Topic::ALL
        .iter()
        .map(|&topic| {
            let file = defining(&files, topic.schema())
                .into_iter()
                .cloned()
                .collect();
            (topic, FileDescriptorSet { file }.encode_to_vec())
        })
        .collect())
}

/// The file that defines `message`, after all that it imports.
fn defining<'a>(files: &'a [FileDescriptorProto], message: &str) -> Vec<&'a FileDescriptorProto> {
    let mut found = Vec::new();
    let defines = |file: &&FileDescriptorProto| {
        message
            .strip_prefix(file.package())
            .and_then(|rest| rest.strip_prefix('.'))
            .is_some_and(|name| file.message_type.iter().any(|known| known.name() == name))
    };
    if let Some(file) = files.iter().find(defines) {
        add(files, file, &mut HashSet::new(), &mut found);
    }
    found
}

fn add<'a>(
    files: &'a [FileDescriptorProto],
    file: &'a FileDescriptorProto,
    seen: &mut HashSet<&'a str>,
    found: &mut Vec<&'a FileDescriptorProto>,
) {
    if !seen.insert(file.name()) {
        return;
    }
    for import in &file.dependency {
        if let Some(file) = files.iter().find(|file| file.name() == import) {
            add(files, file, seen, found);
        }
    }
    found.push(file);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_schema_defines_its_message_and_everything_it_imports() {
        for (topic, schema) in schemas().unwrap() {
            let files = FileDescriptorSet::decode(schema.as_slice()).unwrap().file;
            let last = files.last().unwrap();
            let name = topic.schema().rsplit('.').next().unwrap();
            assert!(
                last.message_type
                    .iter()
                    .any(|message| message.name() == name),
                "{topic:?}"
            );
            let names: Vec<_> = files.iter().map(|file| file.name()).collect();
            for file in &files {
                for import in &file.dependency {
                    assert!(names.contains(&import.as_str()), "{topic:?}: {import}");
                }
            }
        }
    }
}
