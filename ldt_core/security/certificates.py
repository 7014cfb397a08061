"""Keys, certificates and signatures of a keystore, by the `cryptography` library.

DDS-Security 1.1, 9.3.1 and 9.4.1: elliptic keys on the curve P-256, X.509 certificates, documents
signed as S/MIME in clear text.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass

from ldt_core.base.errors import LdtError

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.hazmat.primitives.serialization import (
        Encoding,
        NoEncryption,
        PrivateFormat,
        pkcs7,
    )
except ImportError as error:
    raise LdtError(
        "a keystore needs the library cryptography, which is not installed: "
        "pip install 'ldt[security]'"
    ) from error


@dataclass(frozen=True)
class Identity:
    """A key and its certificate."""

    key: ec.EllipticCurvePrivateKey
    certificate: x509.Certificate

    @property
    def key_pem(self) -> bytes:
        """The private key, not encrypted: whoever may read the file has it."""
        return self.key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption())

    @property
    def certificate_pem(self) -> bytes:
        """The certificate."""
        return self.certificate.public_bytes(Encoding.PEM)


@dataclass(frozen=True)
class Authority:
    """Who signs everything in a keystore.

    Args:
        begin: from when on all is valid [UTC].
        end: until when [UTC].
    """

    identity: Identity
    begin: datetime.datetime
    end: datetime.datetime

    def certify(self, name: str) -> Identity:
        """A new key, certified as the subject `CN=name`."""
        key = ec.generate_private_key(ec.SECP256R1())
        issuer = self.identity.certificate.subject
        builder = _certificate(_subject(name), issuer, key, self.begin, self.end)
        builder = builder.add_extension(x509.BasicConstraints(False, None), critical=True)
        return Identity(key, builder.sign(self.identity.key, hashes.SHA256()))

    def sign(self, document: str) -> bytes:
        """The document as S/MIME, readable in clear text, with the authority's signature."""
        builder = pkcs7.PKCS7SignatureBuilder().set_data(document.encode())
        builder = builder.add_signer(self.identity.certificate, self.identity.key, hashes.SHA256())
        options = [pkcs7.PKCS7Options.Text, pkcs7.PKCS7Options.DetachedSignature]
        return builder.sign(Encoding.SMIME, options)


def new_authority(name: str, begin: datetime.datetime, end: datetime.datetime) -> Authority:
    """An authority with a new key."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _subject(name)
    builder = _certificate(subject, subject, key, begin, end)
    builder = builder.add_extension(x509.BasicConstraints(True, 0), critical=True)
    certificate = builder.sign(key, hashes.SHA256())
    return Authority(Identity(key, certificate), begin, end)


def read_certificate(pem: bytes) -> x509.Certificate:
    """A certificate out of its file.

    Raises:
        ValueError: there is none.
    """
    return x509.load_pem_x509_certificate(pem)


def _subject(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])


def _certificate(
    subject: x509.Name,
    issuer: x509.Name,
    key: ec.EllipticCurvePrivateKey,
    begin: datetime.datetime,
    end: datetime.datetime,
) -> x509.CertificateBuilder:
    return x509.CertificateBuilder(
        issuer_name=issuer,
        subject_name=subject,
        public_key=key.public_key(),
        serial_number=x509.random_serial_number(),
        not_valid_before=begin,
        not_valid_after=end,
    )
