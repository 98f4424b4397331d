//! Fallible allocation, for sizes that come from files or settings: an error instead of an abort. The available memory.

use std::path::Path;

use bytemuck::Zeroable;
use bytemuck::allocation::try_zeroed_vec;

use crate::error::{Error, Result};

/// Returns an empty vector with room for `count` elements. `what` names them in the error.
pub fn reserved<T>(count: u64, what: impl FnOnce() -> String) -> Result<Vec<T>> {
    let mut elements = Vec::new();
    match usize::try_from(count).map(|count| elements.try_reserve_exact(count)) {
        Ok(Ok(())) => Ok(elements),
        _ => Err(refused::<T>(count, what)),
    }
}

/// Makes a vector of `count` zeros. The system provides pages when they are written to, so the missing samples of a
/// short file cost no time.
pub fn zeroed<T: Zeroable>(count: u64, what: impl FnOnce() -> String) -> Result<Vec<T>> {
    let fits = |count: &usize| count.checked_mul(size_of::<T>()).is_some_and(|bytes| bytes <= isize::MAX as usize);
    let elements = usize::try_from(count).ok().filter(fits).and_then(|count| try_zeroed_vec(count).ok());
    elements.ok_or_else(|| refused::<T>(count, what))
}

fn refused<T>(count: u64, what: impl FnOnce() -> String) -> Error {
    Error::Memory { what: what(), bytes: count.saturating_mul(size_of::<T>() as u64) }
}

/// Refuses work for which there are no `bytes` of memory.
///
/// To be called before encoders and decoders of other crates, which abort if an allocation fails.
pub fn check(bytes: u64, what: impl FnOnce() -> String) -> Result<()> {
    reserved::<u8>(bytes, what).map(drop)
}

/// Returns the purpose of memory for the samples of a file, for messages.
pub fn samples_in(path: &Path) -> String {
    format!("the samples of {}", path.display())
}

/// The memory that a process can still get.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Available {
    /// The number of bytes that the process can still get.
    pub bytes: u64,
    /// The name of the limit, for messages.
    pub limit: &'static str,
}

/// Returns the memory that this process can still get: what the machine has left, its control group, or its limit of
/// address space, whichever is least. `None` if the system does not say, as outside of Linux.
#[must_use]
pub fn available() -> Option<Available> {
    available_in(Path::new("/"))
}

/// Returns the memory that this process can still get, by the files of a system below `root`.
fn available_in(root: &Path) -> Option<Available> {
    let read = |path: &str| std::fs::read_to_string(root.join(path)).ok();
    let of = |bytes: Option<u64>, limit| bytes.map(|bytes| Available { bytes, limit });
    let kilobytes = |text: &str, name: &str| Some(field(text, name)?.saturating_mul(1024));
    let machine = read("proc/meminfo").and_then(|text| {
        Some(kilobytes(&text, "MemAvailable:")?.saturating_add(kilobytes(&text, "SwapFree:").unwrap_or(0)))
    });
    let space = read("proc/self/limits").and_then(|text| {
        let most = field(&text, "Max address space")?;
        Some(most.saturating_sub(kilobytes(&read("proc/self/status")?, "VmSize:")?))
    });
    let groups = read("proc/self/cgroup").unwrap_or_default();
    let groups = groups.lines().filter_map(|line| {
        let mut parts = line.splitn(3, ':').skip(1);
        match (parts.next()?, parts.next()?) {
            ("", path) => Some(("sys/fs/cgroup", path, ["memory.max", "memory.current", ""])),
            (of, path) if of.split(',').any(|of| of == "memory") => {
                let files = ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_"];
                Some(("sys/fs/cgroup/memory", path, files))
            }
            _ => None,
        }
    });
    // Limits of groups above hold too. Inside of a container the path may not exist, and its group is the root.
    let left = groups.flat_map(|(mount, path, [most, used, prefix])| {
        let paths = Path::new(path.trim_start_matches('/')).ancestors().map(|at| Path::new(mount).join(at));
        paths.filter_map(move |at| {
            let number = |file: &str| read(at.join(file).to_str()?)?.trim().parse::<u64>().ok();
            // Cached files give way.
            let statistics = read(at.join("memory.stat").to_str()?).unwrap_or_default();
            let cached = ["inactive_file ", "active_file "].map(|name| field(&statistics, &format!("{prefix}{name}")));
            let used = number(used)?.saturating_sub(cached.iter().flatten().sum());
            Some(number(most)?.saturating_sub(used))
        })
    });
    let all =
        [of(machine, "the machine"), of(left.min(), "its control group"), of(space, "its limit of address space")];
    all.into_iter().flatten().min_by_key(|available| available.bytes)
}

/// Returns the first number behind a name at the beginning of a line.
fn field(text: &str, name: &str) -> Option<u64> {
    let rest = text.lines().find_map(|line| line.strip_prefix(name))?;
    rest.split_whitespace().next()?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_cannot_be_had_is_an_error() {
        assert!(reserved::<u64>(1000, String::new).unwrap().capacity() >= 1000);
        assert_eq!(zeroed::<u16>(3, String::new).unwrap(), [0; 3]);
        for count in [u64::MAX, 1 << 62] {
            let error = reserved::<u64>(count, || "a test".to_owned()).unwrap_err();
            assert_eq!(error.to_string(), format!("no memory for a test: {} bytes", count.saturating_mul(8)));
            assert!(check(count, String::new).is_err() && zeroed::<u64>(count, String::new).is_err());
        }
    }

    #[test]
    fn the_least_of_machine_control_group_and_address_space_is_available() {
        let dir = tempfile::tempdir().unwrap();
        let write = |path: &str, text: &str| {
            let path = dir.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        let found = || available_in(dir.path()).map(|available| (available.bytes, available.limit));
        assert_eq!(found(), None);
        write("proc/meminfo", "MemTotal:  9000 kB\nMemAvailable:    5000 kB\nSwapFree:   1000 kB\n");
        write("proc/self/status", "Name: x\nVmSize:\t  1000 kB\n");
        write("proc/self/limits", "Max address space         unlimited            unlimited            bytes\n");
        assert_eq!(found(), Some((6000 << 10, "the machine")));
        // Version 2, with a limit of the group above; cached files give way.
        write("proc/self/cgroup", "0::/a/b\n");
        write("sys/fs/cgroup/a/b/memory.max", "max\n");
        write("sys/fs/cgroup/a/b/memory.current", "1\n");
        write("sys/fs/cgroup/a/memory.max", "4000000\n");
        write("sys/fs/cgroup/a/memory.current", "3000000\n");
        write("sys/fs/cgroup/a/memory.stat", "anon 5\ninactive_file 200000\nactive_file 300000\n");
        assert_eq!(found(), Some((1_500_000, "its control group")));
        // Version 1 in a container, whose path is not there.
        write("proc/self/cgroup", "4:cpu,memory:/docker/1\n");
        write("sys/fs/cgroup/memory/memory.limit_in_bytes", "5000000\n");
        write("sys/fs/cgroup/memory/memory.usage_in_bytes", "4000000\n");
        write("sys/fs/cgroup/memory/memory.stat", "inactive_file 1\ntotal_inactive_file 1000000\n");
        assert_eq!(found(), Some((2_000_000, "its control group")));
        write("proc/self/limits", "Max address space         1124000              unlimited            bytes\n");
        assert_eq!(found(), Some((100_000, "its limit of address space")));
    }
}
