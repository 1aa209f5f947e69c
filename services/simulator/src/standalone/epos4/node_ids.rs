//! Which nodes are on the bus: `1-4`, `2,5`.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Node ids, each once, as they were listed; at least one.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct NodeIds {
    ids: Vec<u8>,
    text: String,
}

/// A list that names no nodes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{text:?} is no list of nodes: {problem}; use 1-4 or 2,5 with ids of 1 to 127")]
pub struct NotNodeIds {
    text: String,
    problem: &'static str,
}

impl NodeIds {
    /// The ids.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        &self.ids
    }
}

impl Default for NodeIds {
    /// The four axes.
    fn default() -> Self {
        Self {
            ids: vec![1, 2, 3, 4],
            text: "1-4".to_owned(),
        }
    }
}

impl FromStr for NodeIds {
    type Err = NotNodeIds;

    fn from_str(text: &str) -> Result<Self, NotNodeIds> {
        let bad = |problem| NotNodeIds {
            text: text.to_owned(),
            problem,
        };
        let mut ids = Vec::new();
        for part in text.split(',') {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            let id = |word: &str| {
                word.trim()
                    .parse::<u8>()
                    .ok()
                    .filter(|id| (1..=127).contains(id))
                    .ok_or_else(|| bad("an id is not within 1 to 127"))
            };
            let (first, last) = (id(first)?, id(last)?);
            if first > last {
                return Err(bad("a range runs backwards"));
            }
            for id in first..=last {
                if ids.contains(&id) {
                    return Err(bad("an id stands twice"));
                }
                ids.push(id);
            }
        }
        Ok(Self {
            ids,
            text: text.to_owned(),
        })
    }
}

impl fmt::Display for NodeIds {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl TryFrom<String> for NodeIds {
    type Error = NotNodeIds;

    fn try_from(text: String) -> Result<Self, NotNodeIds> {
        text.parse()
    }
}

impl From<NodeIds> for String {
    fn from(nodes: NodeIds) -> Self {
        nodes.text
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_and_lists_are_read() {
        let ids = |text: &str| text.parse::<NodeIds>().unwrap().as_slice().to_vec();
        assert_eq!(ids("1-4"), [1, 2, 3, 4]);
        assert_eq!(ids("7"), [7]);
        assert_eq!(ids("2, 5-6,127"), [2, 5, 6, 127]);
        assert_eq!(NodeIds::default().as_slice(), [1, 2, 3, 4]);
    }
}
