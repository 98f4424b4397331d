//! Urls and the credentials in them.

use std::borrow::Cow;
use std::path::Path;

#[cfg(feature = "remote")]
use super::s3::{Signer, encoded, endpoint};

/// The beginnings of urls that are read.
const SCHEMES: [&str; 3] = ["https://", "http://", "s3://"];

/// Returns whether a source is a url: `https://..`, `http://..` or `s3://BUCKET/KEY`.
#[must_use]
pub fn is_url(source: &Path) -> bool {
    let text = source.as_os_str().as_encoded_bytes();
    SCHEMES
        .iter()
        .any(|scheme| text.get(..scheme.len()).is_some_and(|head| head.eq_ignore_ascii_case(scheme.as_bytes())))
}

/// Returns a text without credentials of the urls in it, which are users, passwords and queries.
#[must_use]
pub fn without_credentials(text: &str) -> Cow<'_, str> {
    if !text.contains("://") {
        return Cow::Borrowed(text);
    }
    let mut plain = String::new();
    let mut rest = text;
    while let Some(at) = rest.find("://") {
        let (before, url) = rest.split_at(at + 3);
        plain += before;
        let ends = |c: char| c.is_whitespace() || c.is_control() || ['"', '\'', '<', '>', '`'].contains(&c);
        let (url, behind) = url.split_at(url.find(ends).unwrap_or(url.len()));
        let (authority, path) = url.split_at(url.find(['/', '?', '#']).unwrap_or(url.len()));
        plain += authority.rsplit_once('@').map_or(authority, |(_, host)| host);
        // A colon behind the name of a file begins an explanation, behind a query it may be a part of it.
        plain += path.split_once('?').map_or(path, |(path, _)| path);
        rest = behind;
    }
    Cow::Owned(plain + rest)
}

/// A url that a user has given.
#[cfg(feature = "remote")]
pub(super) struct Address {
    /// The url without credentials, and without a slash at its end: the path of the source.
    pub(super) shown: String,
    /// The scheme and the host of `shown`, or its bucket; `base` is its address.
    origin: String,
    base: String,
    /// The query with its question mark; empty if there is none.
    query: String,
    /// The value of the header `Authorization`.
    pub(super) authorization: Option<String>,
    pub(super) signer: Option<Signer>,
}

#[cfg(feature = "remote")]
impl Address {
    /// Parses a url. Without a signature, S3 is read anonymously.
    pub(super) fn parse(text: &str, variable: &dyn Fn(&str) -> Option<String>) -> Result<Self, &'static str> {
        let (scheme, rest) = text.split_once("://").ok_or("expected https://, http:// or s3://")?;
        let scheme = scheme.to_ascii_lowercase();
        let (authority, path) = rest.split_at(rest.find(['/', '?']).unwrap_or(rest.len()));
        let (user, host) = authority.rsplit_once('@').map_or((None, authority), |(user, host)| (Some(user), host));
        if host.is_empty() || host.contains(char::is_whitespace) {
            return Err("is a url without a host");
        }
        let (path, query, base, signer) = match scheme.as_str() {
            // Names of objects may have any character.
            "s3" => (path, "", endpoint(host, variable), Signer::of(variable)?),
            _ => {
                let (path, query) = path.split_at(path.find('?').unwrap_or(path.len()));
                (path, query, format!("{scheme}://{host}"), None)
            }
        };
        let origin = format!("{scheme}://{host}");
        let authorization = user.filter(|_| scheme != "s3").map(|user| {
            use base64::Engine;
            format!("Basic {}", base64::engine::general_purpose::STANDARD.encode(decoded(user)))
        });
        let shown = format!("{origin}{}", path.trim_end_matches('/'));
        Ok(Self { shown, origin, base, query: query.to_owned(), authorization, signer })
    }

    /// Returns the url of a path at the same origin.
    pub(super) fn url(&self, path: &str) -> String {
        let path = path.strip_prefix(&self.origin).unwrap_or_default().replace(std::path::MAIN_SEPARATOR, "/");
        // A url is encoded already, except for the names that files state. Names of S3 are not.
        let kept: &[u8] = if self.origin.starts_with("s3:") { b"/" } else { b"/%!$&'()*+,;=:@" };
        format!("{}{}{}", self.base, encoded(&path, kept), self.query)
    }

    /// Returns whether a path is the source, in it or beside it, in this order of nearness.
    pub(super) fn nearness(&self, path: &str) -> Option<u32> {
        let is_in = |folder: &str| path.strip_prefix(folder).is_some_and(|rest| rest.starts_with(['/', '\\']));
        let folder = self.shown.rsplit_once('/').map_or("", |(folder, _)| folder);
        match path == self.shown || is_in(&self.shown) {
            true => Some(0),
            false => (folder.len() >= self.origin.len() && is_in(folder)).then_some(1),
        }
    }

    /// Returns whether the host is this machine, to which no proxy leads.
    pub(super) fn is_local(&self) -> bool {
        let host = self.base.split_once("://").map_or("", |(_, rest)| rest);
        ["localhost", "127.", "[::1]"].iter().any(|local| host.starts_with(local))
    }
}

/// Decodes the bytes that are encoded by percent signs.
#[cfg(feature = "remote")]
fn decoded(text: &str) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut rest = text.as_bytes();
    while let Some((&byte, behind)) = rest.split_first() {
        let digits = behind.get(..2).filter(|_| byte == b'%').and_then(|digits| std::str::from_utf8(digits).ok());
        let code = digits.and_then(|digits| u8::from_str_radix(digits, 16).ok());
        bytes.push(code.unwrap_or(byte));
        rest = if code.is_some() { &behind[2..] } else { behind };
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_lose_the_credentials_of_urls() {
        for (text, plain) in [
            ("no url, a@b?c", "no url, a@b?c"),
            ("https://u:p@h:8/a.zarr?token=x", "https://h:8/a.zarr"),
            ("cannot read https://u:p%40@h/a: x@y", "cannot read https://h/a: x@y"),
            (r#"{"a": "http://h/a?b=c", "d": "s3://b/k"}"#, r#"{"a": "http://h/a", "d": "s3://b/k"}"#),
            ("'https://h?x=1' and https://u@i", "'https://h' and https://i"),
            ("https://h/a@b.nii", "https://h/a@b.nii"),
        ] {
            assert_eq!(without_credentials(text), plain);
        }
        assert!(is_url(Path::new("HTTPS://h/a")) && !is_url(Path::new("a/https://h")) && !is_url(Path::new("C:/a")));
    }

    #[cfg(feature = "remote")]
    #[test]
    fn urls_keep_their_credentials_for_requests() {
        let none = |_: &str| None;
        let address = Address::parse("https://u:p%20@h:8/a%20b.zarr/?token=x", &none).unwrap();
        assert_eq!(address.shown, "https://h:8/a%20b.zarr");
        // "u:p " in base64.
        assert_eq!(address.authorization.as_deref(), Some("Basic dTpwIA=="));
        assert_eq!(address.url("https://h:8/a%20b.zarr/s 0/c"), "https://h:8/a%20b.zarr/s%200/c?token=x");
        let near = ["https://h:8/a%20b.zarr/0", "https://h:8/c", "https://h:80/c", "https://h:8"];
        assert_eq!(near.map(|path| address.nearness(path)), [Some(0), Some(1), None, None]);
        for bad in ["https://", "http:///a", "https://u@/a", "s3:///k"] {
            assert_eq!(Address::parse(bad, &none).err(), Some("is a url without a host"), "{bad}");
        }
    }

    #[cfg(feature = "remote")]
    #[test]
    fn buckets_have_the_address_of_their_endpoint() {
        let url = |source: &str, set: &[(&str, &str)]| {
            let variable = |name: &str| set.iter().find(|(of, _)| *of == name).map(|(_, value)| (*value).to_owned());
            let address = Address::parse(source, &variable).unwrap();
            (address.url(source), address.signer.is_some())
        };
        let plain = |text: &str| (text.to_owned(), false);
        assert_eq!(url("s3://b/k a+?", &[]), plain("https://b.s3.amazonaws.com/k%20a%2B%3F"));
        assert_eq!(url("s3://b/k", &[("AWS_REGION", "eu-west-1")]), plain("https://b.s3.eu-west-1.amazonaws.com/k"));
        assert_eq!(url("s3://b.c/k", &[]), plain("https://s3.amazonaws.com/b.c/k"));
        assert_eq!(url("s3://b/k", &[("AWS_ENDPOINT_URL", "http://h:9/")]), plain("http://h:9/b/k"));
        let keys = [("AWS_ACCESS_KEY_ID", "a"), ("AWS_SECRET_ACCESS_KEY", "b")];
        assert_eq!(url("s3://b/k", &keys), ("https://b.s3.us-east-1.amazonaws.com/k".to_owned(), true));
        let half = |name: &str| (name == "AWS_ACCESS_KEY_ID").then(|| "a".to_owned());
        assert!(Address::parse("s3://b/k", &half).is_err());
    }
}
