// The build script and a test of the digest include this file by `include!`; the build script
// cannot depend on the library.

/// The 128-bit FNV-1a hash of named contents: for each content the name, the length, the bytes.
///
/// The hash depends on the order, so sort the contents. A changed byte, a moved byte and a renamed
/// file change the hash.
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
