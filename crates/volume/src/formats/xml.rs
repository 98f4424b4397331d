//! The tags of XML, one at a time: enough for headers that keep all they say in attributes.
//!
//! No XML crate is used: samples stand between the tags of VTK's files, as text of any length or as bytes that are no
//! XML at all, and are read in place.

use super::input::Input;
use crate::error::Result;

/// A tag of XML: `<name attribute="value">`.
#[derive(Debug, PartialEq)]
pub(super) struct Tag {
    /// The name of the tag, with a slash before it in a closing tag.
    pub(super) name: String,
    attributes: Vec<(String, String)>,
}

impl Tag {
    /// Reads the next tag of a stream and skips the text before it; `None` at the end of the file. Comments,
    /// declarations and processing instructions are skipped too.
    pub(super) fn next(input: &mut Input) -> Result<Option<Self>> {
        while let Some(text) = input.tag()? {
            if let Some(tag) = Self::parse(&text) {
                return Ok(Some(tag));
            }
        }
        Ok(None)
    }

    /// Returns the tags of a text.
    pub(super) fn all(text: &str) -> impl Iterator<Item = Self> {
        text.split('<').skip(1).filter_map(|piece| Self::parse(piece.split_once('>')?.0))
    }

    /// Parses the text between `<` and `>`; `None` if it is no tag.
    fn parse(text: &str) -> Option<Self> {
        let text = text.strip_suffix('/').unwrap_or(text);
        let name_end = text.find(|c: char| c.is_ascii_whitespace()).unwrap_or(text.len());
        let (name, mut rest) = text.split_at(name_end);
        if name.is_empty() || name.starts_with(['!', '?']) {
            return None;
        }
        let mut attributes = Vec::new();
        while let Some((key, after)) = rest.split_once('=') {
            let value = after.trim_start();
            let Some(quote) = value.chars().next().filter(|c| matches!(c, '"' | '\'')) else { break };
            let Some((value, after)) = value[1..].split_once(quote) else { break };
            attributes.push((key.trim().to_owned(), unescaped(value)));
            rest = after;
        }
        Some(Self { name: name.to_owned(), attributes })
    }

    /// Returns the value of an attribute.
    pub(super) fn get(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(key, _)| key == name).map(|(_, value)| value.as_str())
    }
}

/// Returns a text with its entities replaced. Entities that no header needs stay as they are.
fn unescaped(text: &str) -> String {
    let entities = [("&lt;", "<"), ("&gt;", ">"), ("&quot;", "\""), ("&apos;", "'"), ("&amp;", "&")];
    entities.iter().fold(text.to_owned(), |text, (entity, character)| text.replace(entity, character))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tags_have_their_attributes() {
        let text = "<?xml version='1.0'?><!-- <none --><a b = \"1 &lt; 2\" c='\"'/>text<d>\n</d\n>< =><e f=1><g h=\"";
        let tags: Vec<Tag> = Tag::all(text).collect();
        let names: Vec<&str> = tags.iter().map(|tag| tag.name.as_str()).collect();
        assert_eq!(names, ["none", "a", "d", "/d", "e"]);
        assert_eq!((tags[1].get("b"), tags[1].get("c"), tags[1].get("d")), (Some("1 < 2"), Some("\""), None));
        assert_eq!(tags[4].get("f"), None);
    }
}
