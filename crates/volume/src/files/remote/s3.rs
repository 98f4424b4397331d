//! Requests of S3: endpoints and signatures, by the variables of the environment that AWS names.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use ring::{digest, hmac};

/// The hash of an empty body.
const EMPTY: &str = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";

/// Returns the region that the environment states.
fn region(variable: &dyn Fn(&str) -> Option<String>) -> Option<String> {
    variable("AWS_REGION").or_else(|| variable("AWS_DEFAULT_REGION"))
}

/// Returns the address of a bucket.
pub(super) fn endpoint(bucket: &str, variable: &dyn Fn(&str) -> Option<String>) -> String {
    if let Some(endpoint) = variable("AWS_ENDPOINT_URL_S3").or_else(|| variable("AWS_ENDPOINT_URL")) {
        return format!("{}/{bucket}", endpoint.trim_end_matches('/'));
    }
    // Signatures are of one region; without one, this host finds the region of the bucket.
    let region = region(variable).or_else(|| variable("AWS_ACCESS_KEY_ID").map(|_| "us-east-1".to_owned()));
    let host = region.map_or("s3".to_owned(), |region| format!("s3.{region}"));
    match bucket.contains('.') {
        // The certificate of a host is for one name before the region.
        true => format!("https://{host}.amazonaws.com/{bucket}"),
        false => format!("https://{bucket}.{host}.amazonaws.com"),
    }
}

/// A signer of requests, version 4 (<https://docs.aws.amazon.com/AmazonS3/latest/API/sig-v4-header-based-auth.html>).
pub(super) struct Signer {
    id: String,
    secret: String,
    token: Option<String>,
    region: String,
}

impl Signer {
    /// Returns the signer with the keys of the environment; `None` without keys.
    pub(super) fn of(variable: &dyn Fn(&str) -> Option<String>) -> Result<Option<Self>, &'static str> {
        let region = region(variable).unwrap_or_else(|| "us-east-1".to_owned());
        match (variable("AWS_ACCESS_KEY_ID"), variable("AWS_SECRET_ACCESS_KEY")) {
            (Some(id), Some(secret)) => Ok(Some(Self { id, secret, token: variable("AWS_SESSION_TOKEN"), region })),
            (None, None) => Ok(None),
            _ => Err("needs both AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or neither to read anonymously"),
        }
    }

    /// Returns the headers that sign a request without a body.
    pub(super) fn headers(
        &self,
        method: &str,
        url: &str,
        range: Option<&str>,
        now: SystemTime,
    ) -> Vec<(&'static str, String)> {
        let (host, path) = url.split_once("://").and_then(|(_, rest)| rest.split_once('/')).unwrap_or_default();
        let time = timestamp(now);
        let date = time.split('T').next().unwrap_or_default().to_owned();
        let mut headers = vec![("host", host.to_owned())];
        headers.extend(range.map(|range| ("range", range.to_owned())));
        headers.extend([("x-amz-content-sha256", EMPTY.to_owned()), ("x-amz-date", time.clone())]);
        headers.extend(self.token.clone().map(|token| ("x-amz-security-token", token)));
        let listed: String = headers.iter().map(|(name, value)| format!("{name}:{value}\n")).collect();
        let names = headers.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(";");
        let request = format!("{method}\n/{path}\n\n{listed}\n{names}\n{EMPTY}");
        let scope = format!("{date}/{}/s3/aws4_request", self.region);
        let hash = hex(digest::digest(&digest::SHA256, request.as_bytes()).as_ref());
        let text = format!("AWS4-HMAC-SHA256\n{time}\n{scope}\n{hash}");
        let mut key = format!("AWS4{}", self.secret).into_bytes();
        for part in [date.as_str(), self.region.as_str(), "s3", "aws4_request", text.as_str()] {
            key = hmac::sign(&hmac::Key::new(hmac::HMAC_SHA256, &key), part.as_bytes()).as_ref().to_vec();
        }
        let credential = encoded(&self.id, b"/+=");
        let signature = hex(&key);
        headers.push((
            "authorization",
            format!("AWS4-HMAC-SHA256 Credential={credential}/{scope},SignedHeaders={names},Signature={signature}"),
        ));
        // The client writes the host itself.
        headers.retain(|(name, _)| !["host", "range"].contains(name));
        headers
    }
}

/// Encodes all bytes by percent signs but letters, digits, `-._~` and the kept ones.
pub(super) fn encoded(text: &str, kept: &[u8]) -> String {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || b"-._~".contains(&byte) || kept.contains(&byte);
    let encode = |byte: u8| if is_plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") };
    text.bytes().map(encode).collect()
}
fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Returns a time as YYYYMMDDTHHMMSSZ.
fn timestamp(time: SystemTime) -> String {
    let seconds = time.duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs();
    let (mut days, second) = (seconds / 86_400, seconds % 86_400);
    let is_leap = |year: u64| year.is_multiple_of(4) && !year.is_multiple_of(100) || year.is_multiple_of(400);
    let mut year = 1970;
    while days >= 365 + u64::from(is_leap(year)) {
        days -= 365 + u64::from(is_leap(year));
        year += 1;
    }
    let lengths = [31, 28 + u64::from(is_leap(year)), 31, 30, 31, 30, 31, 31, 30, 31, 30, 31];
    let mut month = 0;
    while days >= lengths[month] {
        days -= lengths[month];
        month += 1;
    }
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("{year}{:02}{:02}T{hour:02}{minute:02}{:02}Z", month + 1, days + 1, second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The example of AWS: "GET Object" at the address above.
    #[test]
    fn signatures_are_those_of_the_specification() {
        let signer = Signer {
            id: "AKIAIOSFODNN7EXAMPLE".to_owned(),
            secret: "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY".to_owned(),
            token: None,
            region: "us-east-1".to_owned(),
        };
        let time = UNIX_EPOCH + Duration::from_secs(1_369_353_600);
        let url = "https://examplebucket.s3.amazonaws.com/test.txt";
        let headers = signer.headers("GET", url, Some("bytes=0-9"), time);
        assert!(headers.contains(&("x-amz-date", "20130524T000000Z".to_owned())));
        let signature = "f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41";
        assert!(headers.last().unwrap().1.ends_with(signature), "{headers:?}");
    }

    #[test]
    fn times_are_dates() {
        let at = |seconds| timestamp(UNIX_EPOCH + Duration::from_secs(seconds));
        assert_eq!(at(0), "19700101T000000Z");
        assert_eq!(at(951_782_399 + 86_400), "20000229T235959Z");
        assert_eq!(at(1_767_225_599), "20251231T235959Z");
    }
}
