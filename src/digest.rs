// Read by `include!`: by the build script, which cannot depend on the library, and by a test of the digest.

/// The FNV-1a hash of 128 bits of named contents: of each the name, the length, the bytes.
///
/// The order counts, so sort them. A changed byte, a moved byte and a renamed file change it.
pub(crate) fn digest<'a>(files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> u128 {
    // The prime is 2^88 + 0x13b.
    const PRIME: u128 = (1 << 88) + 0x13b;
    let mut hash: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
    let mut add = |bytes: &[u8]| {
        for byte in bytes {
            hash = (hash ^ u128::from(*byte)).wrapping_mul(PRIME);
        }
    };
    for (name, bytes) in files {
        add(&(name.len() as u64).to_le_bytes());
        add(name.as_bytes());
        add(&(bytes.len() as u64).to_le_bytes());
        add(bytes);
    }
    hash
}
